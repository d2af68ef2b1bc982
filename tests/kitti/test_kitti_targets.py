"""Training targets: foreground points, association displacements."""

import numpy as np
import pytest

from kitti.ground import GroundModel
from kitti.targets import association_displacement, foreground_labels, point_displacement

CAR = np.array([10.0, 0, 0.75, 4, 2, 1.5, 0])
ON_ROAD, IN_CAR, OUTSIDE = [10.0, 0.5, 0.05], [10.0, 0.5, 0.8], [20.0, 0, 1.0]
POINTS = np.array([ON_ROAD, IN_CAR, OUTSIDE], np.float32)
ROAD = GroundModel(np.zeros(6), 1.0, np.zeros(2), 1.0, np.zeros((1, 1)))  # z = 0 everywhere


def _moved(box, x=0.0, y=0.0, z=0.0):
    return box + np.array([x, y, z, 0, 0, 0, 0])


def test_foreground_is_in_a_box_and_above_ground():
    boxes = np.stack([_moved(CAR, 30), CAR])
    assert foreground_labels(POINTS, boxes).tolist() == [1, 1, -1]
    assert foreground_labels(POINTS, boxes, ROAD).tolist() == [-1, 1, -1]
    mask = np.array([False, True, True])
    assert foreground_labels(POINTS, boxes, mask).tolist() == [1, -1, -1]
    assert foreground_labels(POINTS, np.zeros((0, 7)), ROAD).tolist() == [-1, -1, -1]
    assert foreground_labels(POINTS, boxes, ROAD).dtype == np.int32


def test_displacement_follows_the_id():
    before = np.stack([CAR, _moved(CAR, 5, 5), _moved(CAR, 9)])
    after = np.stack([_moved(before[2], 1, 2, 3), _moved(before[0], 0.5)])
    disp, valid = association_displacement(before, [7, 8, 9], after, [9, 7])
    np.testing.assert_allclose(disp, [[0.5, 0, 0], [0, 0, 0], [1, 2, 3]], atol=1e-6)
    assert valid.tolist() == [True, False, True]
    assert (disp.dtype, valid.dtype) == (np.float64, bool)


@pytest.mark.parametrize(("m", "k"), [(0, 0), (0, 2), (2, 0)])
def test_displacement_of_empty_frames(m, k):
    disp, valid = association_displacement(np.ones((m, 7)), range(m), np.ones((k, 7)), range(k))
    assert disp.shape == (m, 3)
    assert not valid.any()


def test_points_take_their_boxs_displacement():
    disp = np.array([[1.0, 2, 3], [4, 5, 6]])
    moved = point_displacement(np.array([1, -1, 0, 1]), disp)
    assert moved.tolist() == [[4, 5, 6], [0, 0, 0], [1, 2, 3], [4, 5, 6]]
    assert moved.dtype == np.float32
    assert point_displacement(np.array([-1, -1]), np.zeros((0, 3))).tolist() == [[0, 0, 0]] * 2


def test_points_moved_by_their_displacement_are_in_the_next_box():
    from kitti.boxes import points_in_boxes

    rng = np.random.default_rng(0)
    points = rng.uniform([5, -4, 0], [15, 4, 2], (2000, 3)).astype(np.float32)
    index = foreground_labels(points, CAR[None])
    after = _moved(CAR, 1.5, -0.5, 0.1)
    disp, _ = association_displacement(CAR[None], [3], after[None], [3])
    moved = points + point_displacement(index, disp)
    assert (index >= 0).sum() > 50
    assert (points_in_boxes(moved[index >= 0], after[None], margin=1e-5) == 0).all()
