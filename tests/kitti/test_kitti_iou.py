"""IoU: derivations by hand, properties, and a reference that counts points."""

import numpy as np
import pytest
from helpers.overlap import iou_bev
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti.boxes import points_in_boxes, transform_boxes
from kitti.iou import (
    giou_3d,
    giou_3d_pairs,
    iou_3d,
    iou_3d_pairs,
    iou_bev_pairs,
)

near = st.floats(-4, 4)
size = st.floats(0.2, 6)
angle = st.floats(-3.1, 3.1)
boxes = st.tuples(near, near, near, size, size, size, angle).map(np.array)
functions = pytest.mark.parametrize("function", [iou_3d, iou_bev, giou_3d])

UNIT = np.array([0.0, 0, 0, 2, 2, 2, 0])


def _shifted(**change):
    box = UNIT.copy()
    for name, value in change.items():
        box[["x", "y", "z", "l", "w", "h", "yaw"].index(name)] = value
    return box


@pytest.mark.parametrize(
    ("other", "iou", "bev"),
    [
        (_shifted(), 1, 1),
        (_shifted(x=1), 4 / (8 + 8 - 4), 2 / (4 + 4 - 2)),
        (_shifted(x=1, y=1), 2 / (16 - 2), 1 / 7),
        (_shifted(z=1), 4 / 12, 1),
        (_shifted(z=2), 0, 1),
        (_shifted(x=2), 0, 0),
        (_shifted(x=2.1), 0, 0),
        (_shifted(yaw=np.pi / 2), 1, 1),
        (_shifted(l=1, w=1, h=1), 1 / 8, 1 / 4),
        # A square turned by 45 degrees leaves a regular octagon of inradius 1: area 8 tan(pi/8).
        (_shifted(yaw=np.pi / 4), *[8 * np.tan(np.pi / 8) / (8 - 8 * np.tan(np.pi / 8))] * 2),
    ],
)
def test_by_hand(other, iou, bev):
    assert iou_3d(UNIT[None], other[None])[0, 0] == pytest.approx(iou, abs=1e-12)
    assert iou_bev(UNIT[None], other[None])[0, 0] == pytest.approx(bev, abs=1e-12)


def test_giou_by_hand():
    # 4 m apart: hull 6 x 2 x 2 = 24, union 16, no overlap -> -(24 - 16) / 24.
    assert giou_3d(UNIT[None], _shifted(x=4)[None])[0, 0] == pytest.approx(-8 / 24)
    # Half over each other: hull 3 x 2 x 2 = 12 is the union itself -> plain IoU.
    assert giou_3d(UNIT[None], _shifted(x=1)[None])[0, 0] == pytest.approx(4 / 12)
    assert giou_3d(UNIT[None], _shifted(z=3)[None])[0, 0] == pytest.approx(-(20 - 16) / 20)


@given(boxes)
def test_with_itself_is_one(box):
    for function in (iou_3d, iou_bev, giou_3d):
        assert function(box[None], box[None])[0, 0] == pytest.approx(1, abs=1e-9)


@given(boxes, boxes)
def test_symmetric_and_in_range(a, b):
    for function, low in ((iou_3d, 0), (iou_bev, 0), (giou_3d, -1)):
        ab, ba = function(a[None], b[None])[0, 0], function(b[None], a[None])[0, 0]
        assert ab == pytest.approx(ba, abs=1e-9)
        assert low <= ab <= 1


@given(boxes, boxes, st.floats(-90, 90), st.floats(-90, 90), st.floats(-5, 5), angle)
def test_unchanged_by_a_rigid_motion(a, b, x, y, z, turn):
    motion = np.eye(4)
    motion[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    motion[:3, 3] = x, y, z
    moved_a, moved_b = transform_boxes(a, motion), transform_boxes(b, motion)
    for function in (iou_3d, iou_bev, giou_3d):
        before, after = function(a[None], b[None]), function(moved_a, moved_b)
        np.testing.assert_allclose(after, before, atol=1e-7)


@given(boxes, boxes)
def test_turning_by_half_a_turn_changes_nothing(a, b):
    turned = a.copy()
    turned[6] += np.pi
    np.testing.assert_allclose(iou_3d(turned[None], b[None]), iou_3d(a[None], b[None]), atol=1e-9)


@pytest.mark.parametrize(("along", "turn"), [(0, 0), (0.1, 0), (None, 0), (0, np.pi)])
def test_edges_on_the_same_lines(along, turn):
    """Same width and heading, other length: GEOS's intersection is empty for some of these."""
    n, rng = 3000, np.random.default_rng(1)
    a = np.column_stack([np.zeros((n, 3)), rng.uniform(1.4, 5, (n, 3)), rng.uniform(-3, 3, n)])
    b = a.copy()
    b[:, 3] *= 1.3
    b[:, 6] += turn
    shift = 0.15 * a[:, 3] if along is None else along  # None: the rear edges coincide as well
    b[:, 0] += shift * np.cos(a[:, 6])
    b[:, 1] += shift * np.sin(a[:, 6])
    np.testing.assert_allclose(iou_3d_pairs(a, b), 1 / 1.3, atol=1e-9)
    np.testing.assert_allclose(iou_bev_pairs(b, a), 1 / 1.3, atol=1e-9)


@settings(max_examples=15)
@given(boxes, boxes)
def test_against_random_points(a, b):
    # 40,000 points: the share of a that b covers has a standard error below 0.0025.
    grid = np.random.default_rng(0).uniform(-0.5, 0.5, (40_000, 3)) * a[3:6]
    cos, sin = np.cos(a[6]), np.sin(a[6])
    inside_a = grid @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]) + a[:3]
    shared = (points_in_boxes(inside_a, b[None]) == 0).mean() * a[3:6].prod()
    union = a[3:6].prod() + b[3:6].prod() - shared
    assert iou_3d(a[None], b[None])[0, 0] == pytest.approx(shared / union, abs=0.025)


@functions
@pytest.mark.parametrize(("m", "k"), [(0, 0), (0, 3), (2, 0)])
def test_nothing_against_something(function, m, k):
    assert function(np.zeros((m, 7)), np.ones((k, 7))).shape == (m, k)


def test_rows_without_a_box_overlap_nothing():
    a = np.stack([np.full(7, np.nan), UNIT])
    assert iou_3d(a, a).tolist() == [[0, 0], [0, 1]]
    assert iou_bev(a, a).tolist() == [[0, 0], [0, 1]]
    assert giou_3d(a, a).tolist() == [[-1, -1], [-1, 1]]


@pytest.mark.parametrize(
    ("pairs", "matrix"),
    [(iou_3d_pairs, iou_3d), (giou_3d_pairs, giou_3d)],
)
def test_pairs_are_the_matrix_row_by_row(pairs, matrix):
    rng = np.random.default_rng(0)
    some = np.column_stack(
        [rng.uniform(-4, 4, (12, 3)), rng.uniform(1, 5, (12, 3)), rng.uniform(-3, 3, 12)]
    )
    a, b = some[:5], some[5:]
    i, j = np.indices((5, 7)).reshape(2, -1)
    np.testing.assert_array_equal(pairs(a[i], b[j]).reshape(5, 7), matrix(a, b))
