"""poses/00XX.txt in KITTI odometry's layout: camera 0 of frame t in camera 0 of frame 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.files import write_text
from kitti.calibration import LEVEL_FROM_CAMERA


def write_poses(path: str | Path, poses) -> None:
    """Writes level-frame poses (F, 4, 4); they are expressed relative to the first one."""
    turn = np.eye(4)
    turn[:3, :3] = LEVEL_FROM_CAMERA
    relative = turn.T @ (np.linalg.inv(poses[0]) @ poses) @ turn
    rows = relative[:, :3].reshape(len(relative), 12)
    write_text(path, "".join(" ".join(f"{v:.9f}" for v in row) + "\n" for row in rows))
