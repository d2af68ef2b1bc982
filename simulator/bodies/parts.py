"""Convex parts as planes: extruded side profiles, upright cylinders with corners, wheels."""

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from simulator.bodies.convex import Body


@dataclass
class Part:
    """One convex part: planes (K, 4) with unit normals, n . p <= d inside; see `Body`."""

    planes: np.ndarray
    reflectivity: float
    interior: bool = False
    porosity: float = 0.0
    gloss: float = 0.0
    glass: tuple[int, ...] = ()


@dataclass
class Pane:
    """Extent of the glass on glass faces, in the body's frame."""

    x: tuple[float, float] = (-99.0, 99.0)
    z: tuple[float, float] = (-99.0, 99.0)
    pillars: tuple[float, ...] = field(default_factory=tuple)


def assemble(parts: list[Part], pane: Pane | None = None) -> Body:
    """A `Body` of these parts; shorter lists of planes are padded with planes without effect."""
    pane = pane or Pane()
    count = max(len(part.planes) for part in parts)
    planes = np.zeros((len(parts), count, 4), np.float32)
    planes[..., 3] = 1.0
    glass = np.zeros((len(parts), count), bool)
    for index, part in enumerate(parts):
        planes[index, : len(part.planes)] = part.planes
        glass[index, list(part.glass)] = True
    return Body(
        planes=planes,
        reflectivity=np.array([part.reflectivity for part in parts], np.float32),
        gloss=np.array([part.gloss for part in parts], np.float32),
        interior=np.array([part.interior for part in parts]),
        porosity=np.array([part.porosity for part in parts], np.float32),
        glass=glass,
        pane=np.array([*pane.x, *pane.z], np.float32),
        pillars=np.array(pane.pillars, np.float32),
        spheres=np.array([bounding_ball(part.planes) for part in parts], np.float32),
    )


def bounding_ball(planes) -> np.ndarray:
    """Centre and radius (4,) of a ball around the part that planes (K, 4) bound.

    Its corners are the meeting points of three planes that violate no other plane.
    """
    planes = np.asarray(planes, np.float64)
    triples = np.array(list(combinations(range(len(planes)), 3)))
    normals, offsets = planes[triples, :3], planes[triples, 3]
    meets = np.abs(np.linalg.det(normals)) > 1e-6
    corners = np.linalg.solve(normals[meets], offsets[meets][..., None])[..., 0]
    corners = corners[(corners @ planes[:, :3].T <= planes[:, 3] + 1e-6).all(axis=1)]
    if not len(corners):
        return np.zeros(4)  # an empty part: never hit
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return np.array([*center, np.linalg.norm(corners - center, axis=1).max() + 1e-3])


def profile_planes(points) -> np.ndarray:
    """Planes (n, 4) of a convex side profile; points (n, 2) of (x, z), counter-clockwise when x
    points right and z up. Plane i holds points i and i + 1."""
    points = np.asarray(points, np.float64)
    edge = np.roll(points, -1, axis=0) - points
    normal = np.stack([edge[:, 1], np.zeros(len(edge)), -edge[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset = normal[:, 0] * points[:, 0] + normal[:, 2] * points[:, 1]
    return np.column_stack([normal, offset])


def side_planes(half_width: float, at_z: float = 0.0, lean_rad: float = 0.0) -> np.ndarray:
    """Two planes y = +-half_width at height `at_z`, leaning inwards above it by `lean_rad`."""
    cos, sin = np.cos(lean_rad), np.sin(lean_rad)
    offset = cos * half_width + sin * at_z
    return np.array([[0, cos, sin, offset], [0, -cos, sin, offset]])


def corner_planes(x_front: float, x_rear: float, half_width: float, cut: float) -> np.ndarray:
    """Four upright planes that cut the plan's corners: `cut` metres of the half width."""
    planes = []
    for x, angle in ((x_front, 0.62), (x_rear, 0.5)):
        for side in (1.0, -1.0):
            normal = np.array([np.sign(x) * np.cos(angle), side * np.sin(angle), 0.0])
            planes.append([*normal, normal @ [x, side * (half_width - cut), 0.0]])
    return np.array(planes)


def block(center, size, top_scale: float = 1.0) -> np.ndarray:
    """Planes (6, 4) of an axis-parallel block; `top_scale` < 1 makes its top narrower."""
    (cx, cy, cz), (sx, sy, sz) = center, size
    lean = np.arctan2((1 - top_scale) * min(sx, sy) / 2, sz)
    cos, sin = np.cos(lean), np.sin(lean)
    low = cz - sz / 2
    planes = [
        [cos, 0, sin, cos * (cx + sx / 2) + sin * low],
        [-cos, 0, sin, cos * (sx / 2 - cx) + sin * low],
        [0, cos, sin, cos * (cy + sy / 2) + sin * low],
        [0, -cos, sin, cos * (sy / 2 - cy) + sin * low],
        [0, 0, 1, cz + sz / 2],
        [0, 0, -1, sz / 2 - cz],
    ]
    return np.array(planes, np.float64)


def wheel(x: float, y: float, z: float, radius: float, width: float) -> np.ndarray:
    """Planes of a wheel with ten sides, its axis along y."""
    angle = np.arange(10) * (2 * np.pi / 10)
    normal = np.stack([np.cos(angle), np.zeros(10), np.sin(angle)], axis=1)
    rim = np.column_stack([normal, normal @ [x, y, z] + radius])
    return np.vstack([rim, [[0, 1, 0, y + width / 2], [0, -1, 0, width / 2 - y]]])


def column(x: float, y: float, z_low: float, z_high: float, rx: float, ry: float) -> np.ndarray:
    """Planes of an upright column with eight sides and elliptic plan (half axes rx, ry)."""
    angle = (np.arange(8) + 0.5) * (2 * np.pi / 8)
    normal = np.stack([np.cos(angle) / rx, np.sin(angle) / ry, np.zeros(8)], axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    offset = (normal[:, :1] * x + normal[:, 1:2] * y + np.cos(np.pi / 8)) / length
    ends = [[0, 0, 1, z_high], [0, 0, -1, -z_low]]
    return np.vstack([np.column_stack([normal / length, offset]), ends])
