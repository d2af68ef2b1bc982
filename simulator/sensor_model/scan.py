"""One sweep: rays against bodies, static world and ground, then the sensor model."""

from dataclasses import dataclass

import numpy as np

from kitti.boxes import box_corners
from simulator.bodies.convex import FAR, Body, cast_body, to_box_frame
from simulator.config import RETURNS, SENSOR
from simulator.sensor_model.sensor import Rays
from simulator.world.static import StaticWorld, cast_static, make_columns
from simulator.world.terrain import Terrain

GROUND_REFLECTIVITY = 0.15
PANE_RETURN = 0.35  # share of rays on a house's window that return (frame, curtain)


@dataclass(frozen=True)
class Scene:
    """The input of one sweep.

    pose (4, 4): level frame -> world; boxes (M, 7) of the level frame with their bodies (M) and
    velocities (M, 3) relative to the level frame, m/s (None: at rest during the sweep).
    """

    pose: np.ndarray
    boxes: np.ndarray
    bodies: list[Body]
    static: StaticWorld
    terrain: Terrain
    velocities: np.ndarray | None = None


@dataclass(frozen=True)
class Sweep:
    """points (n, 4) f32 x, y, z, intensity in the velodyne frame; owner (n,) int32: row of
    `Scene.boxes`, -1 static world, -2 ground; rays, seen (M,): numbers of rays that meet
    each object without and with occlusion by others."""

    points: np.ndarray
    owner: np.ndarray
    rays: np.ndarray
    seen: np.ndarray


def sweep(scene: Scene, rays: Rays, rng) -> Sweep:
    """Simulates one sweep; `rng` is the only source of randomness."""
    beams, count = rays.direction.shape[:2]
    turn, shift = scene.pose[:3, :3].astype(np.float32), scene.pose[:3, 3]
    origin = (rays.origin.astype(np.float64) @ scene.pose[:3, :3].T + shift).astype(np.float32)
    columns = make_columns(origin, rays.direction @ turn.T)
    static = cast_static(scene.static, columns, rng)
    ground = scene.terrain.cast(columns)
    on_ground = ground < static.distance
    distance = np.minimum(ground, static.distance)
    distance = np.where(distance < FAR, distance * columns.stretch, FAR)
    steepness = np.abs(columns.slope) / columns.stretch + 0.01
    cosine = np.where(on_ground, steepness, static.cosine)
    rough = GROUND_REFLECTIVITY * rng.uniform(0.6, 1.4, (beams, count)).astype(np.float32)
    pane = np.where(rng.random((beams, count)) < PANE_RETURN, np.float32(0.3), 0)
    reflectivity = np.where(static.reflectivity > 0, static.reflectivity, pane)
    reflectivity = np.where(on_ground, rough, reflectivity)
    owner = np.where(on_ground, -2, -1).astype(np.int32)
    first = distance.copy()
    total = np.zeros(len(scene.boxes), np.int64)
    seen = np.zeros(len(scene.boxes), np.int64)
    outlines = []
    for index, (box, body) in enumerate(zip(scene.boxes, scene.bodies, strict=True)):
        velocity = 0.0 if scene.velocities is None else np.linalg.norm(scene.velocities[index])
        window = _window(box, rays, velocity)
        if window is None:
            continue
        hits, where = _cast(scene, index, box, body, rays, window, rng)
        outlines.append((index, where, hits.outline))
        total[index] = (hits.outline < FAR).sum()
        nearer = hits.distance < distance[where]
        for target, value in (
            (distance, hits.distance),
            (cosine, hits.cosine),
            (reflectivity, hits.reflectivity),
            (owner, np.int32(index)),
        ):
            target[where] = np.where(nearer, value, target[where])
        first[where] = np.minimum(first[where], hits.outline)
    for index, where, outline in outlines:
        seen[index] = ((outline < FAR) & (outline <= first[where])).sum()
    return _measure(rays, distance, reflectivity, cosine, owner, (total, seen), rng)


def _window(box, rays: Rays, speed: float) -> tuple[slice, slice] | None:
    """Beams and columns that may meet `box`, from its grown corners; None if there are none.

    speed: of the box, m/s. The box grows by the ways of the sensor and of itself in the sweep.
    """
    starts = rays.origin[0]
    origin = starts[len(starts) // 2]
    moved = np.hypot(*(starts - origin)[:, :2].T).max() + speed * np.abs(rays.time).max()
    grown = np.array(box, np.float64)
    grown[3:6] += np.array([0.1, 0.3, 0.1]) + 2 * moved
    corners = box_corners(grown[None])[0]
    # The level frame is the velodyne frame up to small rotations: corners are looked up among
    # the rays' own angles in the level frame.
    away = corners - origin
    reach = np.hypot(away[:, 0], away[:, 1])
    center = np.hypot(*(grown[:2] - origin[:2]))
    if center > SENSOR.max_range + grown[3] / 2:
        return None
    step = rays.azimuth[1] - rays.azimuth[0]
    if center < np.hypot(grown[3], grown[4]) / 2 + 0.2:
        return slice(0, rays.direction.shape[0]), slice(0, len(rays.azimuth))
    middle = rays.direction[0]
    angle = np.arctan2(middle[:, 1], middle[:, 0])
    ahead = np.arctan2(grown[1] - origin[1], grown[0] - origin[0])
    turn = np.arctan2(away[:, 1], away[:, 0]) - ahead
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    offset = (angle - ahead + np.pi) % (2 * np.pi) - np.pi
    chosen = np.flatnonzero((offset > turn.min() - 4 * step) & (offset < turn.max() + 4 * step))
    if not len(chosen):
        return None
    span = slice(chosen[0], chosen[-1] + 1)  # wraps around behind the car: then all between
    down = np.arctan2(away[:, 2] - 0.35, reach).min() - 0.03
    up = np.arctan2(away[:, 2] + 0.35, reach).max() + 0.03
    beams = np.flatnonzero((rays.elevation > down) & (rays.elevation < up))
    if not len(beams):
        return None
    return slice(beams[0], beams[-1] + 1), span


def _cast(scene: Scene, index, box, body, rays: Rays, window, rng):
    direction = rays.direction[window]
    origin = np.broadcast_to(rays.origin[window], direction.shape)
    if scene.velocities is not None:
        # The object moves during the sweep: the same as rays that start shifted against it.
        moved = rays.time[window[1], None] * scene.velocities[index]
        origin = origin - moved[None].astype(np.float32)
    local_origin, local = to_box_frame(box, origin.reshape(-1, 3), direction.reshape(-1, 3))
    # Only rays near the body's bounding sphere are tested against its planes.
    radius2 = float((np.asarray(box[3:6]) ** 2).sum()) / 4 + 0.3
    along = (local_origin * local).sum(axis=1)
    near = np.flatnonzero((local_origin**2).sum(axis=1) - along**2 < radius2)
    hits = cast_body(body, local_origin[near], local[near], rng)
    columns = direction.shape[1]
    where = (near // columns + window[0].start, near % columns + window[1].start)
    return hits, where


def _measure(rays, distance, reflectivity, cosine, owner, counts, rng) -> Sweep:
    """Applies drop-out, range noise and intensity."""
    power = reflectivity * np.maximum(cosine, 1e-3) ** RETURNS.cosine_power
    margin = np.log(np.maximum(power, 1e-9)) - 2 * np.log(np.clip(distance, 0.5, 1e4))
    chance = RETURNS.base / (1 + np.exp(-RETURNS.slope * (margin - RETURNS.threshold)))
    kept = (rng.random(distance.shape) < chance) & (reflectivity > 0)
    kept &= (distance < SENSOR.max_range) & (distance > SENSOR.min_range)
    noise = rng.normal(0, SENSOR.range_noise, distance.shape).astype(np.float32)
    distance = distance + np.clip(noise, -3 * SENSOR.range_noise, 3 * SENSOR.range_noise)
    points = rays.origin_velo[kept] + rays.direction_velo[kept] * distance[kept, None]
    points = np.round(points / SENSOR.quantum) * np.float32(SENSOR.quantum)
    level = power[kept] * rng.lognormal(0, 0.25, int(kept.sum()))
    intensity = np.round(np.clip(level, 0, 0.99), 2)
    points = np.column_stack([points, intensity]).astype(np.float32)
    return Sweep(points, owner[kept], *counts)
