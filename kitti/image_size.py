"""Size of the left colour image, known from the calibration (the format does not carry it)."""

from __future__ import annotations

from kitti.boxes import IMAGE_SIZE
from kitti.calibration import Calibration

# Focal length of P2 in pixels -> (width, height). KITTI was recorded on five days; rectification
# gave each day's images one size and one focal length (Geiger et al., IJRR 2013, raw data).
_SIZE_BY_FOCAL = {
    721.5377: (1242, 375),  # 2011_09_26
    707.0493: (1224, 370),  # 2011_09_28
    718.3351: (1238, 374),  # 2011_09_29
    707.0912: (1226, 370),  # 2011_09_30
    718.8560: (1241, 376),  # 2011_10_03
}
_SAME_FOCAL = 0.01  # pixels


def image_size_of(calib: Calibration) -> tuple[int, int]:
    """Width and height in pixels; 1242 x 375 for a camera that is none of KITTI's five."""
    for focal, size in _SIZE_BY_FOCAL.items():
        if abs(calib.p2[0, 0] - focal) < _SAME_FOCAL:
            return size
    return IMAGE_SIZE
