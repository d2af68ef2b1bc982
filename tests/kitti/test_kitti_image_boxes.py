"""Overlap of boxes in the image."""

import numpy as np

from kitti.iou import covered, iou_2d, iou_2d_pairs


def test_image_overlap():
    a = np.array([[0, 0, 10, 10], [0, 0, 0, 10]], float)
    b = np.array([[5, 0, 15, 10], [20, 20, 30, 30]], float)
    assert iou_2d(a, b).tolist() == [[50 / 150, 0.0], [0.0, 0.0]]
    assert iou_2d_pairs(a, b).tolist() == [50 / 150, 0.0]
    assert iou_2d_pairs(np.full((1, 4), np.nan), b[:1]).tolist() == [0.0]
    assert covered(a, b).tolist() == [[0.5, 0.0], [0.0, 0.0]]
    assert iou_2d(a[:0], b).shape == (0, 2)
