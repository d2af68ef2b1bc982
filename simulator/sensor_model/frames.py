"""One frame of a data set: a sweep, cropped to the camera's view or not."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from kitti.calibration import Calibration
from kitti.camera_view import in_camera_view
from simulator.sensor_model.scan import Scene, Sweep, sweep
from simulator.sensor_model.sensor import Rays, make_rays


@dataclass(frozen=True)
class Options:
    """Options of sweeps.

    full: 360 degrees instead of the camera's view; motion_distortion: keeps the motion of the car
    and the objects during a sweep (KITTI's scans are corrected for the car's).
    """

    full: bool = False
    motion_distortion: bool = False


def take_sweep(
    scene: Scene,
    calib: Calibration,
    image_size: tuple[int, int],
    options: Options,
    seed: tuple[int, ...],
    ego_velocity=(0.0, 0.0, 0.0),
) -> Sweep:
    """The sweep of one frame, deterministic in `seed`.

    ego_velocity: (vx, vy, yaw rate) of the car in its own frame; used with motion_distortion.
    """
    velocity = ego_velocity if options.motion_distortion else None
    rays = _rays(calib, image_size, options.full, velocity)
    result = sweep(scene, rays, np.random.default_rng(seed))
    if options.full:
        return result
    seen = in_camera_view(calib.velo_to_level(result.points[:, :3]), calib, image_size)
    return Sweep(result.points[seen], result.owner[seen], result.rays, result.seen)


@lru_cache(maxsize=4)
def _rays(
    calib: Calibration,
    image_size: tuple[int, int],
    full: bool,
    velocity: tuple[float, float, float] | None,
) -> Rays:
    return make_rays(calib, image_size, full=full, velocity=velocity)


def ego_velocity(poses: np.ndarray, frame: int, period_s: float) -> tuple[float, float, float]:
    """(vx, vy, yaw rate) of the car at `frame`, from poses (F, 4, 4), in its own frame."""
    first, last = max(frame - 1, 0), min(frame + 1, len(poses) - 1)
    if first == last:
        return 0.0, 0.0, 0.0
    step = np.linalg.inv(poses[first]) @ poses[last]
    time = (last - first) * period_s
    rate = float(np.arctan2(step[1, 0], step[0, 0])) / time
    return float(step[0, 3]) / time, float(step[1, 3]) / time, rate
