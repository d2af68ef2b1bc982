"""Overlap seen from above of all pairs of boxes."""

import numpy as np

from kitti.iou import iou_bev_pairs


def iou_bev(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union seen from above: (M, 7), (K, 7) -> (M, K)."""
    rows, columns = np.indices((len(a), len(b))).reshape(2, -1)
    return iou_bev_pairs(a[rows], b[columns]).reshape(len(a), len(b))
