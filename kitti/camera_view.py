"""How much of a scan the camera sees: the networks look at nothing else."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from common.errors import InputError
from kitti.calibration import Calibration
from kitti.scans import in_camera_view

LEAST_SHARE = 0.005
"""Of the points of a scan; a scanner that looks around has 0.1 to 0.3 in KITTI's view."""


def check_view(
    scans: Iterable[np.ndarray], calib: Calibration, image_size: tuple[int, int]
) -> tuple[int, int]:
    """Points in the camera's view and points in all, over (n, >= 3) scans (Velodyne frame, metres).

    Raises:
        InputError: there are points, but hardly any in the view.
    """
    seen = total = 0
    for points in scans:
        seen += int(in_camera_view(calib.velo_to_level(points[:, :3]), calib, image_size).sum())
        total += len(points)
    if seen < LEAST_SHARE * total:
        raise InputError(
            f"--scans: {seen} of {total} points lie in the camera's view ({image_size[0]} x "
            f"{image_size[1]} pixels), so nothing can be found: expected x ahead, y left, z up in "
            "metres (else --scan_columns such as y,-x,z,i and --scan_scale) and the calibration of "
            "this scanner (--calib, --image_size)"
        )
    return seen, total
