"""Rays of the sensor: one per beam and azimuth step, in the velodyne and the level frame.

Letters: B beams (top to bottom), C azimuth columns (in the order of `azimuth`).
"""

from dataclasses import dataclass

import numpy as np

from kitti.boxes import IMAGE_SIZE
from kitti.calibration import Calibration
from kitti.camera_view import in_camera_view
from simulator.config import SENSOR


@dataclass(frozen=True)
class Rays:
    """Rays of one sweep.

    azimuth (C,) rad, counter-clockwise from the velodyne's x; elevation (B,) rad;
    origin_velo, direction_velo (B, C, 3) f32 in the frame of the scan file;
    origin, direction (B, C, 3) f32 in the level frame; time (C,) s from the sweep's reference.
    """

    azimuth: np.ndarray
    elevation: np.ndarray
    origin_velo: np.ndarray
    direction_velo: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    time: np.ndarray


def beam_table() -> tuple[np.ndarray, np.ndarray]:
    """Elevations (64,) in radians, top to bottom, and heights (64,) of the beams' origins."""
    elevation = [top - step * np.arange(count) for count, top, step, _ in SENSOR.groups]
    heights = [np.full(count, height) for count, _, _, height in SENSOR.groups]
    return np.radians(np.concatenate(elevation)), np.concatenate(heights)


def make_rays(
    calib: Calibration,
    image_size: tuple[int, int] = IMAGE_SIZE,
    *,
    full: bool = False,
    velocity=None,
) -> Rays:
    """Rays of one sweep in the camera's view, or of 360 degrees with `full`.

    velocity: None for a scan corrected for the car's motion, as KITTI's are; else (vx, vy, yaw
    rate) of the car in its own frame, m/s and rad/s: the sensor moves during the sweep and the
    scan is left uncorrected. At the reference time the sensor points forwards.
    """
    elevation, height = beam_table()
    half = 180.0 if full else SENSOR.view_half_angle_deg
    count = round(2 * half / SENSOR.azimuth_step_deg)
    step = np.radians(2 * half / count if full else SENSOR.azimuth_step_deg)
    azimuth = (np.arange(count) - (count - 1) / 2) * step
    if not full:
        beams = _beams_in_view(azimuth, elevation, height, calib, image_size)
        elevation, height = elevation[:beams], height[:beams]
    beams = len(elevation)
    # Lasers fire in sequence, so rings are shifted against each other within a step.
    shift = ((np.arange(beams) * 0.618034) % 1.0 - 0.5) * step
    direction = _directions(azimuth[None, :] + shift[:, None], elevation)
    origin = np.zeros_like(direction)
    origin[..., 2] = height[:, None]
    # The head turns clockwise seen from above: it passes the left side first.
    time = -azimuth / (2 * np.pi) * SENSOR.period_s
    moved_origin, moved_direction = origin, direction
    if velocity is not None:
        moved_origin, moved_direction = _moved(origin, direction, velocity, time)
    rotation = calib.velo_to_level(np.eye(3)) - calib.velo_to_level(np.zeros((1, 3)))
    return Rays(
        azimuth=azimuth,
        elevation=elevation,
        origin_velo=origin.astype(np.float32),
        direction_velo=direction.astype(np.float32),
        origin=calib.velo_to_level(moved_origin.reshape(-1, 3))
        .reshape(moved_origin.shape)
        .astype(np.float32),
        direction=(moved_direction @ rotation).astype(np.float32),
        time=time,
    )


def _directions(angle, elevation) -> np.ndarray:
    """Unit vectors (B, C, 3) from azimuths (B, C) or (1, C) and elevations (B,)."""
    up = elevation[:, None]
    parts = (np.cos(up) * np.cos(angle), np.cos(up) * np.sin(angle), np.sin(up))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _beams_in_view(azimuth, elevation, height, calib: Calibration, image_size) -> int:
    """Number of beams down to the last with a point in the image, `view_nearest` away.

    The camera is below the lasers and ahead of them, so farther points need no more beams.
    """
    points = SENSOR.view_nearest * _directions(azimuth[None, :], elevation)
    points[..., 2] += height[:, None]
    level = calib.velo_to_level(points.reshape(-1, 3))
    seen = in_camera_view(level, calib, image_size).reshape(points.shape[:2])
    return int(np.flatnonzero(seen.any(axis=1)).max(initial=0)) + 1


def _moved(origin, direction, velocity, time):
    """Rays of a sensor that moves with `velocity` (vx, vy, yaw rate), seen from its pose at 0."""
    vx, vy, rate = velocity
    yaw = (rate * time)[None, :]
    cos, sin = np.cos(yaw), np.sin(yaw)

    def turned(vectors):
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack([cos * x - sin * y, sin * x + cos * y, vectors[..., 2]], axis=-1)

    shift = np.stack([vx * time, vy * time, np.zeros_like(time)], axis=-1)
    return turned(origin) + shift[None], turned(direction)
