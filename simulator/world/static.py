"""The static world of boxes, upright cylinders and ellipsoids, and rays against them.

All three are cut by the upright plane of an azimuth column, so a ray is a line in (r, z) there:
r is the horizontal distance, z = height + slope * r. Letters: B beams, C columns, N shapes,
J pairs of a shape and a column that may meet.
"""

from dataclasses import dataclass, field

import numpy as np

from simulator.bodies.convex import FAR

BOX, CYLINDER, ELLIPSOID = 0, 1, 2
REACH = 85.0  # metres; rays that enter a shape beyond it miss


@dataclass(frozen=True)
class Columns:
    """Rays of one sweep in the world, column by column.

    origin (C, 2) and heading (C, 2) unit, f32; height (B,) of the origins, to the
    centimetre; slope (B, C) dz/dr; stretch (B, C) length along the ray per horizontal metre.
    """

    origin: np.ndarray
    heading: np.ndarray
    height: np.ndarray
    slope: np.ndarray
    stretch: np.ndarray


def make_columns(origin, direction) -> Columns:
    """`Columns` from rays of the world frame: origin, direction (B, C, 3)."""
    flat = np.hypot(direction[..., 0], direction[..., 1])
    heading = direction[direction.shape[0] // 3, :, :2]
    slope = direction[..., 2] / flat
    return Columns(
        origin=origin.mean(axis=0)[:, :2].astype(np.float32),
        heading=(heading / np.linalg.norm(heading, axis=-1, keepdims=True)).astype(np.float32),
        height=np.round(origin[..., 2].mean(axis=1), 2).astype(np.float32),
        slope=np.where(np.abs(slope) < 1e-6, 1e-6, slope).astype(np.float32),
        stretch=(1 / flat).astype(np.float32),
    )


@dataclass
class StaticWorld:
    """Shapes as rows: kind, x, y, yaw, half length, half width, z low, z high, reflectivity,
    free path (metres a ray travels inside on average before it returns; 0 solid), street (height
    of the ground from which storeys with windows are counted; NaN: no windows)."""

    rows: list[tuple] = field(default_factory=list)
    _table: np.ndarray | None = None

    def add_box(
        self, x, y, yaw, length, width, low, high, reflectivity, free_path=0.0, street=np.nan
    ):
        """Adds an upright box; lengths in metres."""
        row = (BOX, x, y, yaw, length / 2, width / 2, low, high, reflectivity, free_path, street)
        self.rows.append(row)

    def add_cylinder(self, x, y, radius, low, high, reflectivity, free_path=0.0):
        """Adds an upright cylinder."""
        row = (CYLINDER, x, y, 0, radius, radius, low, high, reflectivity, free_path, np.nan)
        self.rows.append(row)

    def add_ellipsoid(self, x, y, radius, low, high, reflectivity, free_path=0.0):
        """Adds an ellipsoid of revolution about the vertical."""
        row = (ELLIPSOID, x, y, 0, radius, radius, low, high, reflectivity, free_path, np.nan)
        self.rows.append(row)

    def table(self) -> np.ndarray:
        """(N, 11) f32."""
        if self._table is None or len(self._table) != len(self.rows):
            self._table = np.array(self.rows, np.float32).reshape(-1, 11)
        return self._table


@dataclass(frozen=True)
class StaticHits:
    """distance (B, C) f32 horizontal (FAR where missed), reflectivity, cosine (B, C) f32."""

    distance: np.ndarray
    reflectivity: np.ndarray
    cosine: np.ndarray


def cast_static(world: StaticWorld, columns: Columns, rng) -> StaticHits:
    """First return of each ray from the static shapes."""
    beams, count = columns.slope.shape
    best = np.full(beams * count, FAR, np.float32)
    reflectivity = np.zeros(beams * count, np.float32)
    cosine = np.ones(beams * count, np.float32)
    shapes = _near(world.table(), columns)
    for kind, cast in ((BOX, _cast_boxes), (CYLINDER, _cast_round), (ELLIPSOID, _cast_round)):
        chosen = shapes[shapes[:, 0] == kind]
        if not len(chosen):
            continue
        enter, leave, cos, shape, column = cast(chosen, columns)  # (B, J) ... (J,)
        row, pair = np.nonzero((enter < leave) & (enter < REACH))
        distance, shape = enter[row, pair], chosen[shape[pair]]
        free_path = shape[:, 9]
        soft = free_path > 0
        distance[soft] += rng.exponential(1.0, soft.sum()).astype(np.float32) * free_path[soft]
        kept = distance < leave[row, pair]
        index = row[kept] * count + column[pair[kept]]
        distance, shape = distance[kept], shape[kept]
        np.minimum.at(best, index, distance)
        first = best[index] == distance
        index, shape, distance = index[first], shape[first], distance[first]
        value = shape[:, 8].copy()
        z = columns.height[index // count] + columns.slope.ravel()[index] * distance
        value[_in_window(shape, columns, index % count, distance, z)] = 0.0
        reflectivity[index] = value
        cosine[index] = cos[row[kept][first], pair[kept][first]]
    shape = (beams, count)
    return StaticHits(best.reshape(shape), reflectivity.reshape(shape), cosine.reshape(shape))


def _near(table, columns: Columns) -> np.ndarray:
    away = table[:, 1:3] - columns.origin.mean(axis=0)
    return table[np.hypot(*away.T) - np.hypot(table[:, 4], table[:, 5]) < REACH]


def _cast_boxes(shapes, columns: Columns):
    cos, sin = np.cos(shapes[:, 3])[:, None], np.sin(shapes[:, 3])[:, None]
    away = columns.origin[None] - shapes[:, None, 1:3]
    ox, oy = cos * away[..., 0] + sin * away[..., 1], cos * away[..., 1] - sin * away[..., 0]
    hx, hy = columns.heading[None, :, 0], columns.heading[None, :, 1]
    dx, dy = cos * hx + sin * hy, cos * hy - sin * hx
    dx, dy = (np.where(np.abs(d) < 1e-6, np.float32(1e-6), d) for d in (dx, dy))
    half_x, half_y = shapes[:, 4:5], shapes[:, 5:6]
    x_in, x_out = -ox / dx - np.abs(half_x / dx), -ox / dx + np.abs(half_x / dx)
    y_in, y_out = -oy / dy - np.abs(half_y / dy), -oy / dy + np.abs(half_y / dy)
    enter, leave = np.maximum(x_in, y_in), np.minimum(x_out, y_out)
    shape, column = np.nonzero((enter < leave) & (leave > 0) & (enter < REACH))
    side = np.where(x_in > y_in, np.abs(dx), np.abs(dy))[shape, column]
    enter, leave = enter[shape, column][None], leave[shape, column][None]
    slope = columns.slope[:, column]
    to_low = (shapes[shape, 6][None] - columns.height[:, None]) / slope
    to_high = (shapes[shape, 7][None] - columns.height[:, None]) / slope
    z_in, z_out = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    flat = 1 / np.sqrt(1 + slope**2)
    cosine = np.where(z_in > enter, np.abs(slope) * flat, side[None] * flat)
    enter = np.maximum(enter, z_in)
    leave = np.where(enter > 0.3, np.minimum(leave, z_out), -FAR)
    return enter, leave, cosine, shape, column


def _cast_round(shapes, columns: Columns):
    """Cylinders and ellipsoids: the column's plane cuts a rectangle or an ellipse."""
    away = shapes[:, None, 1:3] - columns.origin[None]
    along = away[..., 0] * columns.heading[None, :, 0] + away[..., 1] * columns.heading[None, :, 1]
    miss2 = (away**2).sum(-1) - along**2
    shape, column = np.nonzero((miss2 < shapes[:, 4:5] ** 2) & (along > 0))
    along, miss2 = along[shape, column][None], miss2[shape, column][None]
    radius, low, high = (shapes[shape, k][None] for k in (4, 6, 7))
    slope, height = columns.slope[:, column], columns.height[:, None]
    if len(shapes) and shapes[0, 0] == CYLINDER:
        half = np.sqrt(np.maximum(radius**2 - miss2, 0))
        to_low, to_high = (low - height) / slope, (high - height) / slope
        enter = np.maximum(along - half, np.minimum(to_low, to_high))
        leave = np.minimum(along + half, np.maximum(to_low, to_high))
        cosine = np.broadcast_to(half / radius, slope.shape)
    else:
        # ((r - along)^2 + miss^2) / R^2 + (height + slope r - zc)^2 / H^2 = 1
        center, tall2 = (low + high) / 2, ((high - low) / 2) ** 2
        gap, r2 = height - center, radius**2
        a = 1 / r2 + slope**2 / tall2
        b = along / r2 - slope * gap / tall2
        root = b**2 - a * ((along**2 + miss2) / r2 + gap**2 / tall2 - 1)
        half = np.sqrt(np.maximum(root, 0)) / a
        enter = np.where(root > 0, b / a - half, FAR)
        leave = np.where(root > 0, b / a + half, -FAR)
        cosine = np.full_like(slope, 0.7)
    return enter, np.where(enter > 0.3, leave, -FAR), cosine, shape, column


def _in_window(shape, columns: Columns, column, distance, z) -> np.ndarray:
    """True where hits on facades with windows fall on a pane: three metres a storey and a bay."""
    place = columns.origin[column] + columns.heading[column] * distance[:, None] - shape[:, 1:3]
    cos, sin = np.cos(shape[:, 3]), np.sin(shape[:, 3])
    across = np.abs(cos * place[:, 0] + sin * place[:, 1])
    up = z - shape[:, 10]
    storey = up % 3.0
    return (up > 0) & (across % 3.0 < 1.3) & (storey > 1.2) & (storey < 2.5)
