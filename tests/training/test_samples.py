"""Targets and augmentation of the training samples."""

import dataclasses

import numpy as np
import pytest
from helpers.network_cases import SMALL_DETECTOR
from helpers.overlap import iou_bev
from helpers.two_cars import boxes_at, write_sequence

from common.errors import InputError
from kitti.boxes import points_in_boxes
from kitti.object_shift import ObjectShift
from kitti.objects import Objects
from kitti.sequence import open_sequences
from training.config import AugmentationConfig, DetectorTrainingConfig
from training.sampling.augmentation import SceneTransform
from training.sampling.frame_reader import FrameReader
from training.sampling.frames import frame_list, pair_list, read_frame
from training.sampling.samples import (
    MOST_LEFT,
    detector_sample,
    hidden,
    no_augmentation,
    pair_sample,
    shifted,
)

CLASSES = ("Car", "Van")
CONFIG = DetectorTrainingConfig(dataclasses.replace(SMALL_DETECTOR, num_points=400))


@pytest.fixture(scope="module")
def frames(tiny_data):
    (sequence,) = open_sequences(tiny_data, [0], "training")
    return [read_frame(sequence, t, CLASSES) for t in range(5)]


def test_a_scan_without_points_in_the_view_is_named(tmp_path):
    write_sequence(tmp_path)
    (sequence,) = open_sequences(tmp_path, [0], "training")
    path = sequence.scan_path(1)
    np.array([[-5, 0, -1, 0]], np.float32).tofile(path)  # behind the camera
    with pytest.raises(InputError, match=rf"{path.name}: expected at least 2 points.*found 0"):
        read_frame(sequence, 1, CLASSES)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_foreground_points_tell_the_centre_of_their_box(frames):
    sample = detector_sample(frames[0], CONFIG, no_augmentation(), rng())
    foreground = sample.foreground > 0
    assert foreground.sum() > 50
    centers = (sample.query + sample.targets.center_offset)[foreground]
    distance = np.linalg.norm(centers[:, None] - frames[0].boxes[None, :, :3], axis=-1).min(1)
    assert distance.max() < 1e-4
    assert not sample.targets.center_offset[~foreground].any()
    assert not sample.box_weights[~foreground].any()
    assert sample.box_weights[foreground].mean() == pytest.approx(1.0, abs=1e-5)


def test_query_points_stand_for_all_points(frames):
    config = dataclasses.replace(CONFIG, query_points=200)
    everywhere = detector_sample(frames[0], CONFIG, no_augmentation(), rng())
    some = detector_sample(frames[0], config, no_augmentation(), rng())
    assert len(some.query) == 200
    for label in (0, 1):
        assert some.mask_weights[some.foreground == label].sum() == pytest.approx(
            everywhere.mask_weights[everywhere.foreground == label].sum(), rel=1e-4
        )


def test_augmented_boxes_still_hold_their_points(frames):
    config = AugmentationConfig(object_shift=1.0, object_shift_share=1.0, dropout=0.5)
    for seed in range(8):
        sample = detector_sample(frames[1], CONFIG, config, rng(seed))
        foreground = sample.foreground > 0
        centers = (sample.query + sample.targets.center_offset)[foreground]
        spread = np.unique(np.round(centers, 2), axis=0)
        assert len(spread) <= 2 * 4  # two objects, up to rounding
        assert np.abs(sample.targets.center_offset[foreground]).max() < 2.4


@pytest.mark.parametrize("flip", [False, True])
def test_transform_moves_points_and_boxes_alike(flip):
    transform = SceneTransform(flip, yaw=0.7, scale=1.1, height=0.3)
    box = boxes_at(0)
    points = box[:, :3] + np.array([0.5, 0.2, 0.1])
    np.testing.assert_array_equal(points_in_boxes(points, box), [0, 1])
    moved = transform.boxes(box)
    np.testing.assert_array_equal(points_in_boxes(transform.points(points), moved), [0, 1])
    np.testing.assert_allclose(moved[:, 3:6], 1.1 * box[:, 3:6])


def _moves(before, after):
    """Lengths (M + K,) of the shifts of all labelled objects of a frame."""
    parts = [(a.boxes, a.other_boxes) for a in (before, after)]
    vehicles, others = (new - old for old, new in zip(*parts, strict=True))
    return np.hypot(*np.concatenate([vehicles, others])[:, :2].T)


def test_training_shifts_objects_as_the_evaluation_does(frames):
    """Lengths uniform in [0, D], for every labelled object, in a share of the samples."""
    frame = frames[0]._replace(
        other_boxes=boxes_at(0)[:1] + np.array([15.0, 0, 0, 0, 0, 0, 0]),
        other_ids=np.array([7], np.int32),
    )
    config = AugmentationConfig(object_shift=2.0, object_shift_share=0.5)
    moves = [_moves(frame, shifted([frame], config, rng(seed))[0]) for seed in range(3000)]
    trained = np.array([lengths for lengths in moves if lengths.any()])
    assert len(trained) / len(moves) == pytest.approx(0.5, abs=0.03)
    assert (trained > 0).all()  # the other class too
    labels = Objects.from_boxes(
        np.repeat(np.arange(1000), 3),
        np.tile([*frame.track_ids, 7], 1000),
        np.tile([*frame.boxes, *frame.other_boxes], (1000, 1)),
    )
    tested = np.hypot(*ObjectShift(2.0, seed=1).offsets(labels, 3).T)
    for lengths in (trained.ravel(), tested):
        assert (lengths > 1.0).mean() == pytest.approx(0.5, abs=0.03)
    both = np.sort(np.concatenate([trained.ravel(), tested]))
    below = [np.searchsorted(np.sort(x), both, "right") / len(x) for x in (trained.ravel(), tested)]
    assert np.abs(below[0] - below[1]).max() < 0.04  # Kolmogorov-Smirnov; 0.034 is 1 in 100


def test_objects_of_a_pair_are_shifted_afresh_in_each_frame(frames):
    config = AugmentationConfig(object_shift=2.0, object_shift_share=1.0)
    first, second = shifted([frames[0], frames[0]], config, rng())
    assert (np.abs(first.boxes - second.boxes)[:, :2] > 0).all()


def test_shifted_objects_stay_clear_of_each_other(frames):
    """Six cars 0.4 m apart, and a truck beside them: none is pushed into another."""
    boxes = np.tile(boxes_at(0)[0], (6, 1))
    boxes[:, 0], boxes[:, 1], boxes[:, 6] = 15.0, 2.0 * np.arange(6), 0.0
    truck = np.array([[21.5, 5.0, 0, 8, 2.5, 3, 1.5]])
    frame = frames[0]._replace(
        boxes=boxes,
        classes=np.zeros(6, np.int32),
        track_ids=np.arange(6, dtype=np.int32),
        other_boxes=truck,
        other_ids=np.array([9], np.int32),
    )
    config = AugmentationConfig(object_shift=2.0, object_shift_share=1.0)
    moved = 0
    for seed in range(30):
        (found,) = shifted([frame], config, rng(seed))
        everything = np.concatenate([found.boxes, found.other_boxes])
        assert np.count_nonzero(iou_bev(everything, everything) > 1e-9) == 7  # with themselves
        moved += np.count_nonzero(_moves(frame, found))
    assert moved > 0.8 * 30 * 7


@pytest.mark.parametrize("seed", range(12))
def test_label_of_an_augmented_pair_leads_into_the_other_box(frames, seed):
    """Flip, rotation, scale and shifts together: points moved by their label lie in the box."""
    config = AugmentationConfig(object_shift=2.0, object_shift_share=1.0, rotation=0.8)
    points, displacement, foreground = pair_sample(frames[0], frames[2], 400, config, rng(seed))
    boxes = _boxes_of_pair((frames[0], frames[2]), config, seed)
    for here in (0, 1):
        owner = points_in_boxes(points[here], boxes[here], margin=1e-3)
        chosen = foreground[here] == 1
        assert chosen.sum() > 40
        assert (owner[chosen] >= 0).all()
        there = points[here, chosen] + displacement[here, chosen]
        for box in (0, 1):
            turned_back = boxes[1 - here][box].copy()
            turned_back[6] = boxes[here][box, 6]
            led = there[owner[chosen] == box]
            assert (points_in_boxes(led, turned_back[None], margin=2e-3) == 0).all()


def _boxes_of_pair(frames, config, seed):
    """The boxes that `pair_sample` makes of the frames, with the same draws."""
    draws = rng(seed)
    moved = shifted(frames, config, draws)
    transform = SceneTransform.random(config, draws)
    return [transform.boxes(frame.boxes) for frame in moved]


def test_dont_care_regions_are_background_for_neither_network(frames):
    everywhere = np.ones(len(frames[0].points), bool)
    frame = frames[0]._replace(ignored=everywhere)
    pair = pair_sample(frame, frames[1], 400, no_augmentation(), rng())
    assert set(np.unique(pair.foreground[0])) == {-1, 1}
    assert set(np.unique(pair.foreground[1])) == {0, 1}
    assert not pair.displacement[0][pair.foreground[0] == -1].any()
    sample = detector_sample(frame, CONFIG, no_augmentation(), rng())
    np.testing.assert_array_equal(sample.mask_weights > 0, sample.foreground > 0)


def test_pair_displacement_is_the_motion_of_the_box(frames):
    sample = pair_sample(frames[0], frames[1], 400, no_augmentation(), rng())
    motion = boxes_at(1)[0, :3] - boxes_at(0)[0, :3]
    for points, displacement, foreground, expected in zip(*sample, (motion, -motion), strict=True):
        moving = (foreground == 1) & (points[:, 1] > 0)
        parked = (foreground == 1) & (points[:, 1] < 0)
        assert moving.sum() > 20
        np.testing.assert_allclose(displacement[moving], [expected] * moving.sum(), atol=1e-4)
        np.testing.assert_allclose(displacement[parked], 0, atol=1e-4)
        assert not displacement[foreground == 0].any()


def test_an_object_that_leaves_is_ignored(frames):
    gone = frames[1]._replace(
        boxes=frames[1].boxes[1:], classes=frames[1].classes[1:], track_ids=frames[1].track_ids[1:]
    )
    points, displacement, foreground = pair_sample(frames[0], gone, 400, no_augmentation(), rng())
    left = (foreground[0] == -1) & (points[0, :, 1] > 0)
    assert left.sum() > 20
    assert not displacement[foreground == -1].any()
    assert not (foreground[1] == -1).any()


@pytest.mark.parametrize("seed", range(4))
def test_hidden_vehicles_lose_points_and_keep_their_displacement(frames, seed):
    """Each vehicle is hidden in one of the frames; in the other its label stays the true one."""
    pair = [frame.only(~frame.ground) for frame in (frames[0], frames[1])]
    found = hidden(pair, 1.0, rng(seed))
    counts = np.array([[_owned(f, box) for box in range(2)] for f in (*pair, *found)])
    shares = counts[2:] / counts[:2]
    assert (shares.max(axis=0) == 1).all()  # frame by vehicle
    assert (shares.min(axis=0) < MOST_LEFT + 0.1).all()
    for before, after in zip(pair, found, strict=True):
        outside = np.count_nonzero(points_in_boxes(before.points, before.boxes) < 0)
        assert np.count_nonzero(points_in_boxes(after.points, after.boxes) < 0) == outside
    config = dataclasses.replace(no_augmentation(), hidden_vehicles=1.0)
    sample = pair_sample(*pair, 400, config, rng(seed))
    motion = boxes_at(1)[0, :3] - boxes_at(0)[0, :3]
    assert (sample.foreground >= 0).all()
    for here, expected in enumerate((motion, -motion)):
        moving = (sample.foreground[here] == 1) & (sample.points[here, :, 1] > 0)
        np.testing.assert_allclose(
            sample.displacement[here, moving].reshape(-1, 3) - expected, 0, atol=1e-4
        )


def _owned(frame, box):
    return np.count_nonzero(points_in_boxes(frame.points, frame.boxes) == box)


def test_a_share_of_the_vehicles_is_hidden(frames):
    pair = (frames[0], frames[1])
    assert hidden(pair, 0.0, rng())[0].points is frames[0].points
    changed = sum(
        len(after.points) < len(before.points)
        for seed in range(200)
        for before, after in zip(pair, hidden(pair, 0.2, rng(seed)), strict=True)
    )
    assert 40 < changed < 115  # 400 frames, 0.19 of them with at least one of two hidden


def test_a_frame_of_one_vehicle_alone_keeps_points(frames):
    inside = frames[0].only(points_in_boxes(frames[0].points, frames[0].boxes) == 0)
    for seed in range(50):
        assert all(len(frame.points) for frame in hidden((inside, inside), 1.0, rng(seed)))


def test_frames_without_objects(frames):
    empty = frames[0]._replace(
        boxes=np.zeros((0, 7)), classes=np.zeros(0, np.int32), track_ids=np.zeros(0, np.int32)
    )
    sample = detector_sample(empty, CONFIG, AugmentationConfig(), rng())
    assert not sample.foreground.any()
    pair = pair_sample(empty, empty, 400, AugmentationConfig(), rng())
    assert not pair.displacement.any()


def test_missing_scans_make_no_pair(tmp_path):
    write_sequence(tmp_path, frames=5, missing=(2,))
    sequences = open_sequences(tmp_path, [0], "training")
    assert frame_list(sequences) == [(0, 0), (0, 1), (0, 3), (0, 4)]
    assert pair_list(sequences) == [(0, 1), (0, 4)]


def test_reader_reads_once(tiny_data):
    reader = FrameReader(open_sequences(tiny_data, [0], "training"), CLASSES)
    assert reader.read(0, 1) is reader.read(0, 1)
