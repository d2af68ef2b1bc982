"""Files of the car's own motion: poses/00XX.txt and oxts/00XX.txt."""

from pathlib import Path

import numpy as np

from common.files import write_text
from kitti.calibration import LEVEL_FROM_CAMERA, Calibration

EARTH_RADIUS = 6378137.0  # metres, as KITTI's raw data devkit has it
START = (49.0, 8.4)  # degrees: latitude and longitude, near Karlsruhe
GRAVITY = 9.81


def write_poses(path: str | Path, poses) -> None:
    """Writes level-frame poses (F, 4, 4) in KITTI odometry's layout.

    A row is the pose of camera 0 of a frame in camera 0 of the first frame.
    """
    turn = np.eye(4)
    turn[:3, :3] = LEVEL_FROM_CAMERA
    relative = turn.T @ (np.linalg.inv(poses[0]) @ poses) @ turn
    rows = relative[:, :3].reshape(len(relative), 12)
    write_text(path, "".join(" ".join(f"{v:.9f}" for v in row) + "\n" for row in rows))


def write_oxts(path: str | Path, poses, calib: Calibration, period_s: float) -> None:
    """Writes KITTI's GPS/IMU file for poses (F, 4, 4) of the level frame in a world with x east.

    The rows are the motion of the IMU, mounted as in `calib` (without an entry: the level frame's).
    Columns of the devkit: lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz
    wf wl wu pos_accuracy vel_accuracy navstat numsats posmode velmode orimode.
    """
    level_from_imu = np.eye(4)
    if calib.tr_imu_to_velo is not None:
        level_from_imu[:3] = calib.tr_imu_to_velo
        level_from_imu = calib.level_from_velo @ level_from_imu
    poses = np.asarray(poses, np.float64) @ level_from_imu
    place, turn = poses[:, :3, 3], poses[:, :3, :3]
    roll = np.arctan2(turn[:, 2, 1], turn[:, 2, 2])
    pitch = -np.arcsin(np.clip(turn[:, 2, 0], -1, 1))
    yaw = np.unwrap(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    velocity, rates = _rate(place, period_s), _rate(np.stack([roll, pitch, yaw], 1), period_s)
    acceleration = _rate(velocity, period_s) + np.array([0.0, 0.0, GRAVITY])
    own = np.einsum("fij,fi->fj", turn, velocity)
    own_acceleration = np.einsum("fij,fi->fj", turn, acceleration)
    scale = np.cos(np.radians(START[0]))
    latitude = START[0] + np.degrees(place[:, 1] / EARTH_RADIUS)
    longitude = START[1] + np.degrees(place[:, 0] / (EARTH_RADIUS * scale))
    columns = np.column_stack(
        [latitude, longitude, place[:, 2], roll, pitch, (yaw + np.pi) % (2 * np.pi) - np.pi,
         velocity[:, 1], velocity[:, 0], own, own_acceleration, own_acceleration, rates, rates]
    )  # fmt: skip
    rows = (" ".join(f"{value:.12g}" for value in row) for row in columns)
    write_text(path, "".join(row + " 0.05 0.02 4 9 4 4 0\n" for row in rows))


def _rate(values, period_s: float) -> np.ndarray:
    return np.gradient(values, period_s, axis=0) if len(values) > 1 else np.zeros_like(values)
