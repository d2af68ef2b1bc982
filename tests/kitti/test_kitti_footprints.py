"""Overlap seen from above against exact areas."""

import numpy as np
from helpers.overlap import iou_bev
from hypothesis import given
from hypothesis import strategies as st

from kitti.iou import footprints_overlap

CAR = np.array([20.0, 0, 0, 4, 2, 1.5, 0.3])


@given(seed=st.integers(0, 2**32 - 1))
def test_agrees_with_the_area_of_the_intersection(seed):
    rng = np.random.default_rng(seed)
    low, high = [-4, -4, -1, 0.3, 0.3, 1, -7], [4, 4, 1, 6, 3, 2, 7]
    a, b = rng.uniform(low, high, (40, 7)), rng.uniform(low, high, (30, 7))
    found, area = footprints_overlap(a[:, None], b[None]), iou_bev(a, b)
    assert found.shape == (40, 30)
    clear = (area == 0) | (area > 1e-9)  # not on the edge of rounding
    np.testing.assert_array_equal(found[clear], area[clear] > 0)
    assert found.any() and not found.all()


def test_touching_boxes_and_missing_boxes_overlap_nothing():
    square = np.array([0.0, 0, 0, 2, 2, 2, 0])
    beside = square + np.array([2.0, 0, 0, 0, 0, 0, 0])
    assert not footprints_overlap(square, beside)
    assert footprints_overlap(square, beside - np.array([0.01, 0, 0, 0, 0, 0, 0]))
    assert not footprints_overlap(CAR, np.full(7, np.nan))
