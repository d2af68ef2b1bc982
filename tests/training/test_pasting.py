"""Cut objects and their pasting: place, ground, collisions, occlusion both ways."""

import dataclasses

import numpy as np
import pytest
from helpers.network_cases import SMALL_DETECTOR
from helpers.overlap import iou_bev
from helpers.two_cars import GROUND, SIZE, boxes_at, side_points

from kitti.boxes import points_in_boxes
from kitti.ground import fit_ground
from kitti.sequence import open_sequences
from training.config import AugmentationConfig, DetectorTrainingConfig
from training.sampling.frames import LabelledFrame, read_frame
from training.sampling.object_bank import MIN_POINTS, CutObject, ObjectBank, cut_objects
from training.sampling.pasting import MIN_VISIBLE, ROOM, paste_objects
from training.sampling.sample_sets import DetectorSamples
from training.sampling.samples import detector_sample

CLASSES = ("Car", "Van")


def rng(seed=0):
    return np.random.default_rng(seed)


def street(*extra: np.ndarray, boxes=(), others=()) -> LabelledFrame:
    """Flat ground in a view of +-40 degrees out to 40 m, with more points (n, 3) on it."""
    azimuth, distance = np.meshgrid(np.deg2rad(np.linspace(-40, 40, 161)), np.linspace(5, 40, 71))
    flat = [distance * np.cos(azimuth), distance * np.sin(azimuth), np.full(azimuth.shape, GROUND)]
    ground = np.stack(flat, -1).reshape(-1, 3)
    points = np.concatenate([ground, *extra]).astype(np.float32)
    on_ground = np.arange(len(points)) < len(ground)
    return LabelledFrame(
        points,
        np.array(boxes, np.float64).reshape(-1, 7),
        np.zeros(len(boxes), np.int32),
        np.arange(len(boxes), dtype=np.int64),
        on_ground,
        np.zeros(len(points), bool),
        fit_ground(points),
        np.array(others, np.float64).reshape(-1, 7),
        np.arange(len(others), dtype=np.int64) + 50,
    )


def car(distance: float, azimuth: float = 0.1, index: int = 0) -> CutObject:
    """A car whose rear faces the sensor, as it would be cut from another scan."""
    box = np.array([distance, 0, GROUND + SIZE[2] / 2, *SIZE, 0.0])
    points = side_points(box, 1500, rng(1))
    c, s = np.cos(azimuth), np.sin(azimuth)
    box[:2], box[6] = (c * distance, s * distance), azimuth
    points[:, :2] = points[:, :2] @ np.array([[c, s], [-s, c]])
    return CutObject(points.astype(np.float32), box, index)


def bank_of(*cuts: CutObject) -> ObjectBank:
    return ObjectBank([{0: list(cuts)}])


@pytest.mark.parametrize("seed", range(5))
def test_a_pasted_object_keeps_its_range_and_stands_on_the_ground(seed):
    frame, cut = street(), car(15.0, azimuth=-0.2)
    found = paste_objects(frame, bank_of(cut), 1, rng(seed))
    (box,) = found.boxes
    assert np.hypot(box[0], box[1]) == pytest.approx(15.0)
    assert box[2] - box[5] / 2 == pytest.approx(GROUND, abs=0.02)
    np.testing.assert_array_equal(box[3:6], cut.box[3:6])
    facing = box[6] - np.arctan2(box[1], box[0])
    assert facing == pytest.approx(cut.box[6] - np.arctan2(cut.box[1], cut.box[0]))
    inside = (points_in_boxes(found.points, box[None], margin=1e-3) == 0) & ~found.ground
    assert np.count_nonzero(inside) >= MIN_VISIBLE
    assert len(found.points) == len(found.ground) == len(found.ignored)
    distances = np.linalg.norm(found.points[inside], axis=1)
    assert distances.min() >= np.linalg.norm(cut.points, axis=1).min() - 0.05


def test_pasted_objects_collide_with_nothing():
    boxes, truck = boxes_at(0), np.array([[10, -3, GROUND + 1.5, 6, 2.5, 3, 0.7]])
    sides = [side_points(box, 200, rng(2)) for box in (*boxes, *truck)]
    frame = street(*sides, boxes=boxes, others=truck)
    bank = bank_of(car(10.0), car(14.0), car(19.0, index=1), car(25.0))
    most = 0
    for seed in range(20):
        found = paste_objects(frame, bank, 8, rng(seed))
        everything = np.concatenate([found.boxes, found.other_boxes])
        wide = everything + np.array([0, 0, 0, 2 * ROOM, 2 * ROOM, 0, 0]) * 0.99
        assert np.count_nonzero(iou_bev(wide, everything) > 0) == len(everything)
        ids = np.concatenate([found.track_ids, found.other_ids])
        assert len(set(ids.tolist())) == len(ids)
        np.testing.assert_array_equal(found.boxes[:2], boxes)
        assert len(found.classes) == len(found.boxes)
        most = max(most, len(found.boxes))
    assert most >= 6


def wall(distance: float) -> np.ndarray:
    """Points of a wall around the sensor, as dense in angle as a sensor sees it."""
    azimuth, elevation = np.meshgrid(
        np.deg2rad(np.arange(-40, 40, 0.2)), np.deg2rad(np.arange(-10, 3, 0.4))
    )
    x, y, z = distance * np.cos(azimuth), distance * np.sin(azimuth), distance * np.tan(elevation)
    points = np.stack([x, y, z], -1).reshape(-1, 3)
    return points[points[:, 2] > GROUND + 0.25]


def test_points_behind_a_pasted_object_are_removed():
    frame = street(wall(30.0))
    found = paste_objects(frame, bank_of(car(12.0)), 1, rng(3))
    (box,) = found.boxes
    bearing = np.arctan2(box[1], box[0])
    far = np.hypot(*found.points[:, :2].T) > 20
    off = np.abs(np.arctan2(found.points[:, 1], found.points[:, 0]) - bearing)
    elevation = np.arctan2(found.points[:, 2], np.hypot(*found.points[:, :2].T))
    roof, floor = np.arctan2([box[2] + box[5] / 2, GROUND + 0.3], 12.0 - box[3] / 2)
    shadow = far & (off < np.deg2rad(2.5)) & (elevation < roof - 0.01) & (elevation > floor + 0.01)
    assert not shadow.any()
    before = np.hypot(*frame.points[:, :2].T) > 20
    assert np.count_nonzero(far) < np.count_nonzero(before)
    aside = off > np.deg2rad(12)
    was_aside = np.abs(np.arctan2(frame.points[:, 1], frame.points[:, 0]) - bearing) > np.deg2rad(
        12
    )
    assert np.count_nonzero(aside) == np.count_nonzero(was_aside)  # nothing else is lost


def test_nothing_is_pasted_behind_a_wall_or_into_it():
    assert len(paste_objects(street(wall(8.0)), bank_of(car(12.0)), 3, rng()).boxes) == 0
    assert len(paste_objects(street(wall(12.0)), bank_of(car(12.0)), 3, rng()).boxes) == 0
    assert len(paste_objects(street(), bank_of(car(12.0)), 3, rng()).boxes) > 0


def test_points_behind_a_nearer_object_are_not_pasted():
    near = wall(8.0)
    halves = near[np.arctan2(near[:, 1], near[:, 0]) > 0.05]  # the left half is behind it
    frame, cut = street(halves), car(12.0)
    counts = []
    for seed in range(40):
        for box in paste_objects(frame, bank_of(cut), 1, rng(seed)).boxes:
            assert np.arctan2(box[1], box[0]) < 0.05 + 0.12  # not wholly behind the wall
            pasted = paste_objects(frame, bank_of(cut), 1, rng(seed))
            inside = points_in_boxes(pasted.points, box[None], margin=1e-3) == 0
            counts.append(np.count_nonzero(inside & ~pasted.ground))
    assert max(counts) == len(cut.points) and min(counts) < 0.8 * len(cut.points)


def test_pasting_is_a_function_of_the_generator():
    frame, bank = street(), bank_of(car(10.0), car(20.0))
    first, again, other = (paste_objects(frame, bank, 3, rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.points, again.points)
    np.testing.assert_array_equal(first.boxes, again.boxes)
    assert not np.array_equal(first.boxes, other.boxes)


def test_objects_are_cut_without_ground_and_only_where_they_are_whole(tiny_data):
    (sequence,) = open_sequences(tiny_data, [0], "training")
    frame = read_frame(sequence, 0, CLASSES)
    cuts = cut_objects(frame)
    assert len(cuts) == 2
    for cut in cuts:
        assert len(cut.points) >= MIN_POINTS
        assert (points_in_boxes(cut.points, cut.box[None]) == 0).all()
        assert (cut.points[:, 2] > GROUND + 0.15).all()
    bearing = np.arctan2(frame.points[:, 1], frame.points[:, 0])
    edge = np.arctan2(3, 12)  # through the first car
    seen = bearing < edge
    half = frame._replace(points=frame.points[seen], ground=frame.ground[seen])
    assert [cut.box[1] for cut in cut_objects(half)] == [-4]
    few = np.flatnonzero(~frame.ground)[::9]
    assert cut_objects(frame._replace(points=frame.points[few], ground=frame.ground[few])) == []


def test_draws_are_balanced_over_roots_and_classes():
    simulated = {0: [car(10.0)] * 97, 1: [car(11.0, index=1)] * 3}
    bank = ObjectBank([simulated, {0: [car(12.0)]}])
    draws, generator = [], rng()
    for _ in range(2000):
        cut = bank.draw(generator)
        draws.append(round(float(np.hypot(*cut.box[:2]))))
    shares = np.bincount(draws, minlength=13)[10:] / 2000
    np.testing.assert_allclose(shares, [0.25, 0.25, 0.5], atol=0.04)


def test_samples_hold_pasted_objects_and_are_the_same_again(tiny_data):
    sequences = open_sequences(tiny_data, [0], "training")
    small = dataclasses.replace(SMALL_DETECTOR, num_points=400)
    plain = AugmentationConfig(object_shift_share=0.0, dropout=0.0)
    pasting = dataclasses.replace(plain, pasted_objects=4)
    config = DetectorTrainingConfig(small)
    counts = []
    for augmentation in (plain, pasting, pasting):
        make = DetectorSamples(sequences, config, augmentation)
        samples = [make(0, position) for position in range(6)]
        counts.append(np.array([sample.foreground.sum() for sample in samples]))
        assert all(len(sample.points) == 400 for sample in samples)
    assert (counts[1] >= counts[0]).all() and (counts[1] > counts[0]).any()
    np.testing.assert_array_equal(counts[1], counts[2])


def test_an_empty_bank_or_scan_changes_nothing():
    frame = street()
    assert paste_objects(frame, ObjectBank([{}]), 3, rng()) is frame
    nothing = frame._replace(
        points=frame.points[:0], ground=frame.ground[:0], ignored=frame.ignored[:0]
    )
    assert paste_objects(nothing, bank_of(car(10.0)), 3, rng()) is nothing
    config = DetectorTrainingConfig(dataclasses.replace(SMALL_DETECTOR, num_points=400))
    augmentation = AugmentationConfig(pasted_objects=2)
    sample = detector_sample(frame, config, augmentation, rng(), ObjectBank([]))
    assert not sample.foreground.any()
