"""Object shifts: distributions, determinism, overlaps; points and detections move along."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti.boxes import points_in_boxes
from kitti.iou import footprints_overlap
from kitti.object_shift import (
    LENGTHS,
    ObjectShift,
    shift_detections,
    shift_objects,
    shift_points,
)
from kitti.objects import Objects

CAR = np.array([20.0, 0, 0, 4, 2, 1.5, 0.3])
readings = pytest.mark.parametrize("hold", [False, True])
PINNED = [[-0.988679827971141, -0.729300742734726], [-0.41840638367346, -1.140218128127087]]
lengths = pytest.mark.parametrize("length", LENGTHS)


def _moved(box, x=0.0, y=0.0, z=0.0):
    return box + np.array([x, y, z, 0, 0, 0, 0])


def _objects(frames, ids):
    frame, track_id = (a.ravel() for a in np.meshgrid(range(frames), range(ids), indexing="ij"))
    boxes = np.tile(CAR, (len(frame), 1))
    boxes[:, 0] += 10.0 * track_id
    return Objects.from_boxes(frame, track_id, boxes, 1.0)


@lengths
@readings
@given(seed=st.integers(0, 2**63 - 1), seq=st.integers(0, 9999), order=st.randoms())
def test_depends_on_the_key_alone(length, hold, seed, seq, order):
    model, objects = ObjectShift(2.0, seed, length, hold), _objects(3, 4)
    offsets = model.offsets(objects, seq)
    rows = list(range(len(objects)))
    order.shuffle(rows)
    rows = np.array(rows[:7])  # any order, any subset
    np.testing.assert_array_equal(model.offsets(objects[rows], seq), offsets[rows])


@lengths
@readings
def test_other_seed_sequence_frame_or_id_gives_other_shifts(length, hold):
    objects = _objects(3, 4)
    first = ObjectShift(2.0, 1, length, hold).offsets(objects, 0)
    for seed, seq in ((2, 0), (1, 1), (0, 1)):
        other = ObjectShift(2.0, seed, length, hold).offsets(objects, seq)
        assert (np.abs(other - first) > 1e-6).all(axis=1).all()
    distinct = len(np.unique(first, axis=0))
    assert distinct == (4 if hold else 12)
    by_frame = first.reshape(3, 4, 2)
    assert (by_frame[0] == by_frame[1]).all() == hold


def test_shifts_stay_as_they_are_over_versions():
    """Pins the hash: figures made with a seed can be made again."""
    offsets = ObjectShift(2.0, 7, "per_axis").offsets(_objects(1, 2), 16)
    np.testing.assert_allclose(offsets, PINNED, atol=1e-12)


def test_uniform_length_and_direction():
    offsets = ObjectShift(2.0, 0, "uniform").offsets(_objects(200, 200), 0)
    reach, bearing = np.hypot(*offsets.T) / 2, np.arctan2(offsets[:, 1], offsets[:, 0])
    assert reach.max() <= 1
    for share in (0.1, 0.5, 0.9):  # 40,000 draws: standard error at most 0.0025
        assert (reach < share).mean() == pytest.approx(share, abs=0.01)
    for turn in (-np.pi / 2, 0, np.pi / 2):
        assert (bearing < turn).mean() == pytest.approx((turn + np.pi) / (2 * np.pi), abs=0.01)
    assert abs(np.corrcoef(reach, bearing)[0, 1]) < 0.02


def test_per_axis_fills_the_square():
    offsets = ObjectShift(2.0, 0, "per_axis").offsets(_objects(200, 200), 0)
    assert np.abs(offsets).max() <= 2
    for share in (0.1, 0.5, 0.9):
        below = (offsets < 4 * share - 2).mean(axis=0)
        np.testing.assert_allclose(below, share, atol=0.01)
    assert abs(np.corrcoef(offsets.T)[0, 1]) < 0.02


def test_neighbouring_frames_and_ids_are_independent():
    x = ObjectShift(1.0, 0, "per_axis").offsets(_objects(200, 200), 0)[:, 0].reshape(200, 200)
    assert abs(np.corrcoef(x[1:].ravel(), x[:-1].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(x[:, 1:].ravel(), x[:, :-1].ravel())[0, 1]) < 0.02


@lengths
@readings
def test_distance_zero_moves_nothing_and_distance_scales(length, hold):
    objects = _objects(2, 3)
    none = ObjectShift(0.0, 5, length, hold).offsets(objects, 1)
    assert not none.any()
    one, two = (ObjectShift(d, 5, length, hold).offsets(objects, 1) for d in (1.0, 2.0))
    np.testing.assert_allclose(two, 2 * one)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"distance": -1.0}, "--object_shift: expected 0 to 1000 metres"),
        ({"distance": np.nan}, "--object_shift"),
        ({"distance": 1.0, "length": "gauss"}, "length: expected one of"),
        ({"distance": 1.0, "seed": -1}, "seed"),
    ],
)
def test_bad_models(bad, message):
    with pytest.raises(ValueError, match=message):
        ObjectShift(**bad)


def test_rows_without_box_or_id_stay():
    dont_care = Objects.from_boxes(0, -1, np.full((1, 7), np.nan), kind="DontCare")
    objects = Objects.concatenate([_objects(1, 1), dont_care])
    offsets = ObjectShift(2.0).offsets(objects, 0)
    assert offsets[0].any()
    assert not offsets[1].any()
    moved = shift_objects(objects, offsets)
    np.testing.assert_allclose(moved.boxes[0, :2], CAR[:2] + offsets[0])
    np.testing.assert_array_equal(moved.boxes[0, 2:], CAR[2:])
    assert np.isnan(moved.boxes[1]).all()
    np.testing.assert_array_equal(moved.bbox[1], objects.bbox[1])


def test_2d_boxes_stay_those_of_the_image():
    objects = _objects(1, 3)
    moved = shift_objects(objects, np.array([[1.0, 0.5], [0, 0], [-100, 0]]))
    np.testing.assert_array_equal(moved.bbox, objects.bbox)
    np.testing.assert_array_equal(moved.alpha, objects.alpha)
    assert moved.boxes[0, 0] == CAR[0] + 1
    assert objects.boxes[0, 0] == CAR[0]  # the input is left alone


def test_points_in_a_box_move_with_it():
    rng = np.random.default_rng(0)
    points = rng.uniform([15, -3, -1, 0], [36, 3, 1, 1], (2000, 4)).astype(np.float32)
    boxes = np.stack([CAR, _moved(CAR, 10)])
    offsets = np.array([[1.0, -2.0], [0.0, 0.5]])
    moved, index = shift_points(points, boxes, offsets), points_in_boxes(points, boxes)
    assert set(index) == {-1, 0, 1}
    for box in (0, 1):
        step = moved[index == box] - points[index == box]
        np.testing.assert_allclose(step, np.tile([*offsets[box], 0, 0], (len(step), 1)), atol=1e-5)
    np.testing.assert_array_equal(moved[index < 0], points[index < 0])
    assert moved.dtype == np.float32


def test_detections_move_with_the_object_they_overlap_most():
    objects = Objects.from_boxes([3, 3, 4], [1, 2, 1], np.stack([CAR, _moved(CAR, 3), CAR]), 1.0)
    offsets = np.array([[1.0, 0], [0, 2.0], [-5, -5]])
    on_first, between, alone = (_moved(CAR, d) for d in (0.2, 2.5, 40.0))
    below = _moved(CAR, z=-9)  # overlaps seen from above, the criterion
    found = Objects.from_boxes([3, 4, 3, 3, 9, 3], -1, np.stack(
        [between, on_first, alone, on_first, on_first, below]), 0.5)  # fmt: skip
    moved = shift_detections(found, objects, offsets)
    step = (moved.boxes - found.boxes)[:, :2]
    expected = [[0, 2], [-5, -5], [0, 0], [1, 0], [0, 0], [1, 0]]
    np.testing.assert_allclose(step, expected, atol=1e-12)


def _crowd(frames=3, ids=14):
    """Parked cars side by side, 0.6 m apart, some of them with a pedestrian at their side."""
    objects = _objects(frames, ids)
    boxes = objects.boxes.copy()
    boxes[:, 0], boxes[:, 1], boxes[:, 6] = 15.0, 2.6 * objects.track_id, 0.1
    person = objects.track_id % 4 == 3
    boxes[person, 3:6] = 0.6, 0.6, 1.8
    boxes[person, 1] -= 1.6  # inside the footprint of the car before
    return replace(objects, boxes=boxes)


def _overlaps(objects):
    same_frame = objects.frame[:, None] == objects.frame
    return footprints_overlap(objects.boxes[:, None], objects.boxes) & same_frame


@lengths
@readings
@given(seed=st.integers(0, 2**63 - 1))
def test_shifts_make_no_new_overlap(length, hold, seed):
    objects = _crowd()
    model = ObjectShift(2.0, seed, length, hold)
    offsets = model.offsets(objects, 0)
    before, after = _overlaps(objects), _overlaps(shift_objects(objects, offsets))
    assert not (after & ~before).any()
    assert (before & ~np.eye(len(objects), dtype=bool)).any()
    assert (np.hypot(*offsets.T) > 0).mean() > 0.7
    by_frame = offsets.reshape(3, -1, 2)
    assert (by_frame == by_frame[0]).all() == hold


def test_shifts_to_the_corners_of_the_square_make_no_new_overlap():
    """Two squares that meet only if each moves farther than D, which `per_axis` allows."""
    objects = _objects(5000, 2)
    boxes = np.tile([20.0, 0, 0, 1, 1, 1, 0], (len(objects), 1))
    boxes[:, :2] += np.where(objects.track_id == 1, 1 + 2.1 * np.sqrt(2), 0)[:, None]
    objects = replace(objects, boxes=boxes)
    moved = shift_objects(objects, ObjectShift(2.1, 0, "per_axis").offsets(objects, 0)).boxes
    assert not footprints_overlap(moved[::2], moved[1::2]).any()


@lengths
@readings
@given(seed=st.integers(0, 2**63 - 1), order=st.randoms())
def test_order_of_rows_does_not_matter_in_a_crowd(length, hold, seed, order):
    objects, model = _crowd(), ObjectShift(2.0, seed, length, hold)
    rows = list(range(len(objects)))
    order.shuffle(rows)
    np.testing.assert_array_equal(
        model.offsets(objects[np.array(rows)], 5), model.offsets(objects, 5)[rows]
    )


def test_redraws_come_from_the_same_distribution_and_lower_ids_go_first():
    objects = _objects(400, 2)
    boxes = objects.boxes.copy()
    boxes[:, 0] = 20.0 + 4.5 * objects.track_id
    crowded = replace(objects, boxes=boxes)
    free, found = (ObjectShift(2.0, 3).offsets(o, 0) for o in (objects, crowded))
    kept = (found == free).all(axis=1)
    first = objects.track_id == 0
    assert 0.5 < kept.mean() < 1
    assert np.hypot(*found.T).max() <= 2
    alone = objects[first]
    others_at_home = footprints_overlap(
        shift_objects(alone, free[first]).boxes, crowded[~first].boxes
    )
    np.testing.assert_array_equal(kept[first], ~others_at_home)


def test_an_object_without_room_keeps_its_place():
    wall = np.array([[20.0, side * 1.01, 0, 40, 0.02, 2, 0] for side in (-1, 1)])
    ends = np.array([[20.0 + side * 2.01, 0, 0, 0.02, 2, 2, 0] for side in (-1, 1)])
    inside = np.array([[20.0, 0, 0, 4, 2, 1.5, 0]])
    boxes = np.concatenate([wall, ends, inside])
    objects = Objects.from_boxes(0, [-1, -1, -1, -1, 7], boxes, 1.0)
    assert not ObjectShift(2.0).offsets(objects, 0).any()
    assert ObjectShift(2.0).offsets(objects[4:], 0).all()


def test_empty_frames_and_files():
    nothing = Objects.empty()
    model = ObjectShift(2.0)
    assert model.offsets(nothing, 0).shape == (0, 2)
    assert len(shift_objects(nothing, np.zeros((0, 2)))) == 0
    some = _objects(1, 2)
    stay = shift_detections(some, nothing, np.zeros((0, 2)))
    np.testing.assert_array_equal(stay.boxes, some.boxes)
    assert len(shift_detections(nothing, some, np.ones((2, 2)))) == 0
