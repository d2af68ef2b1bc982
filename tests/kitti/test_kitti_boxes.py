"""Boxes: conventions, corners, points inside, projection."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti.boxes import (
    box_corners,
    camera_from_level,
    count_points_in_boxes,
    level_from_camera,
    observation_angle,
    points_in_boxes,
    project_boxes,
    to_box_frame,
    transform_boxes,
    wrap_angle,
)

coordinate = st.floats(-90, 90)
size = st.floats(0.05, 30)
angle = st.floats(-3.14159, 3.14159)
boxes = st.tuples(coordinate, coordinate, coordinate, size, size, size, angle).map(np.array)


def _angle_between(a, b):
    return np.abs(wrap_angle(np.asarray(a) - np.asarray(b)))


@given(st.floats(-1e4, 1e4))
def test_wrap_angle(value):
    wrapped = wrap_angle(value)
    assert -np.pi <= wrapped < np.pi
    turns = (value - wrapped) / (2 * np.pi)
    assert abs(turns - round(turns)) < 1e-9


@pytest.mark.parametrize("value", [np.pi, -np.pi, 3 * np.pi, np.nextafter(-np.pi, -4), -1e-20])
def test_wrap_angle_at_the_ends(value):
    assert -np.pi <= wrap_angle(value) < np.pi


def test_wrap_angle_keeps_nan_and_shape():
    wrapped = wrap_angle(np.array([[np.nan, 4.0]]))
    assert wrapped.shape == (1, 2)
    assert np.isnan(wrapped[0, 0])
    assert wrapped[0, 1] == pytest.approx(4.0 - 2 * np.pi)


def test_convention_of_the_design():
    # KITTI: 2 m right, 1.7 m down (bottom), 20 m ahead, driving away: ry = -pi/2 -> yaw 0.
    box = level_from_camera(1.5, 1.6, 4.0, 2.0, 1.7, 20.0, -np.pi / 2)
    np.testing.assert_allclose(box, [20, -2, -1.7 + 0.75, 4.0, 1.6, 1.5, 0], atol=1e-15)
    # ry = 0 faces the camera's x (right): level -y, yaw -pi/2.
    assert level_from_camera(1, 1, 1, 0, 0, 0, 0.0)[6] == pytest.approx(-np.pi / 2)


@given(st.tuples(size, size, size, coordinate, coordinate, coordinate, angle))
def test_camera_to_level_and_back(camera):
    again = camera_from_level(level_from_camera(*camera))
    np.testing.assert_allclose(again, camera, atol=1e-9)


@given(boxes)
def test_level_to_camera_and_back(box):
    again = level_from_camera(*camera_from_level(box[None]))[0]
    np.testing.assert_allclose(again[:6], box[:6], atol=1e-9)
    assert _angle_between(again[6], box[6]) < 1e-9


@pytest.mark.parametrize("ry", [3.141558, -3.141558, 3.141592, -3.141592, np.pi / 2, -np.pi / 2])
def test_ry_near_the_wrap_survives_a_round_trip(ry):
    assert camera_from_level(level_from_camera(1, 1, 1, 0, 0, 0, ry))[6] == pytest.approx(ry)


def test_observation_angle_is_ry_minus_the_bearing():
    box = level_from_camera(1.5, 1.6, 4.0, 5.0, 1.7, 5.0, 0.3)
    assert observation_angle(box) == pytest.approx(0.3 - np.pi / 4)


def test_corners_of_a_turned_box():
    corners = box_corners(np.array([[1.0, 2, 3, 4, 2, 6, np.pi / 2]]))
    # Facing +y: front left is at -x, +y.
    np.testing.assert_allclose(corners[0, 0], [1 - 1, 2 + 2, 3 - 3], atol=1e-12)
    np.testing.assert_allclose(corners[0, 2], [1 + 1, 2 - 2, 3 - 3], atol=1e-12)
    np.testing.assert_allclose(corners[0, 4:, :2], corners[0, :4, :2])
    np.testing.assert_allclose(corners[0, 4:, 2], 6.0)
    assert box_corners(np.zeros((0, 7))).shape == (0, 8, 3)


def _slow_points_in_boxes(points, boxes, margin):
    index = []
    for point in points:
        found = -1
        for m, (x, y, z, length, w, h, yaw) in enumerate(boxes):
            turn = np.exp(-1j * yaw) * complex(point[0] - x, point[1] - y)
            if (
                abs(turn.real) <= length / 2 + margin
                and abs(turn.imag) <= w / 2 + margin
                and abs(point[2] - z) <= h / 2 + margin
            ):
                found = m
                break
        index.append(found)
    return index


@pytest.mark.parametrize("margin", [0.0, 0.3, -0.2])
@pytest.mark.parametrize(("n", "m"), [(0, 3), (5, 0), (400, 1), (400, 9)])
def test_points_in_boxes_against_a_slow_reference(n, m, margin):
    rng = np.random.default_rng(n + m)
    points = rng.uniform(-6, 6, (n, 4)).astype(np.float32)
    some = np.column_stack(
        [rng.uniform(-4, 4, (m, 3)), rng.uniform(0.3, 6, (m, 3)), rng.uniform(-4, 4, m)]
    )
    index = points_in_boxes(points, some, margin)
    assert index.dtype == np.int32
    assert index.tolist() == _slow_points_in_boxes(points, some, margin)


def test_points_on_faces_count_and_the_first_box_wins():
    box = np.array([10.0, 0, 0, 4, 2, 2, 0])
    points = np.array([[12.0, 1, 1], [12.001, 0, 0], [8, -1, -1]])
    assert points_in_boxes(points, np.stack([box, box])).tolist() == [0, -1, 0]


def test_points_are_counted_once_in_the_first_box():
    some = np.array([[x, 0, 0, 4, 2, 2, 0] for x in (11.0, 10.0, np.nan, 50.0)])
    points = np.array([[12.0, 0, 0], [10, 0, 0], [8.5, 0, 0], [-8, 0, 0]])
    assert count_points_in_boxes(points, some).tolist() == [2, 1, 0, 0]
    assert count_points_in_boxes(points[:0], some).tolist() == [0] * 4
    assert count_points_in_boxes(points, some[:0]).shape == (0,)


def test_points_in_boxes_passes_over_rows_without_a_box():
    some = np.stack([np.full(7, np.nan), [0, 0, 0, 2, 2, 2, 0]])
    assert points_in_boxes(np.zeros((1, 3)), some).tolist() == [1]


@given(boxes)
def test_box_frame_puts_corners_at_half_sizes(box):
    local = to_box_frame(box_corners(box[None])[0], box)
    np.testing.assert_allclose(np.abs(local), np.tile(box[3:6] / 2, (8, 1)), atol=1e-9)


def test_transform_boxes_moves_corners_with_it():
    rng = np.random.default_rng(3)
    some = np.column_stack(
        [rng.uniform(-20, 20, (9, 3)), rng.uniform(1, 5, (9, 3)), rng.uniform(-3, 3, 9)]
    )
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]]
    turn[:3, 3] = [3.0, -2.0, 0.5]
    expected = box_corners(some) @ turn[:3, :3].T + turn[:3, 3]
    moved = transform_boxes(some, turn)
    np.testing.assert_allclose(box_corners(moved), expected, atol=1e-9)
    np.testing.assert_allclose(transform_boxes(moved, np.linalg.inv(turn)), some, atol=1e-9)


def test_projection_of_a_box_ahead_is_the_hull_of_its_corners(calib):
    box = np.array([[20.0, 1, -1, 4, 1.6, 1.5, 0.4]])
    uv, _ = calib.project_level(box_corners(box)[0])
    expected = np.concatenate([uv.min(axis=0), uv.max(axis=0)])
    np.testing.assert_allclose(project_boxes(box, calib)[0], expected)


def test_projection_is_clipped_to_the_image(calib):
    left_edge = np.array([[10.0, 8.5, -1, 4, 1.6, 1.5, 0.0]])
    assert project_boxes(left_edge, calib)[0, 0] == 0
    x1, _, x2, _ = project_boxes(np.array([[3.0, 0, 0, 4, 40, 1, 0]]), calib, (1000, 300))[0]
    assert (x1, x2) == (0, 999)


def test_projection_outside_the_image_is_nan(calib):
    behind, beside = [-20.0, 0, -1, 4, 2, 2, 0], [5.0, 40, -1, 4, 2, 2, 0]
    seen = [20.0, 0, -1, 4, 2, 2, 0]
    projected = project_boxes(np.array([behind, beside, [np.nan] * 7, seen]), calib)
    assert np.isnan(projected).all(axis=1).tolist() == [True, True, True, False]
    assert project_boxes(np.zeros((0, 7)), calib).shape == (0, 4)


def test_box_that_reaches_behind_the_camera_is_cut_there(calib):
    # A wall of 12 m beside the car, from behind the camera to 9 m ahead, 2 m to the right:
    # its far end is seen at u = 720 * 2 / 9 + 610 (about), its near end runs out of the image.
    wall = np.array([[3.0, -2.5, 0.0, 12, 1, 2, 0]])
    x1, y1, x2, y2 = project_boxes(wall, calib)[0]
    assert (y1, x2, y2) == (0, 1241, 374)
    assert x1 == pytest.approx((720 * 2 + 45) / 9 + 610, abs=1.0)


@pytest.mark.real
def test_projection_agrees_with_real_2d_labels(kitti_root):
    from kitti.objects import VEHICLES
    from kitti.sequence import KittiSequence

    for seq in (0, 16, 20):
        sequence = KittiSequence(kitti_root, seq)
        cars = sequence.objects.of_classes(VEHICLES)
        cars = cars[(cars.truncation == 0) & (cars.occlusion == 0)]
        found = project_boxes(cars.boxes, sequence.calib, sequence.image_size)
        off = np.abs(found - cars.bbox)
        # The label's 2-D box hugs the car's round outline, the 3-D box's corners stick out.
        assert np.median(off) < 4.0
        assert np.isnan(found).mean() == 0
