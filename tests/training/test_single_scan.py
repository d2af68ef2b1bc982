"""Pairs of frames from one scan: points, ego motion, labels."""

import dataclasses

import numpy as np
import pytest
from helpers.network_cases import SMALL_DETECTOR
from helpers.two_cars import boxes_at, write_sequence

from kitti.boxes import points_in_boxes
from kitti.sequence import open_sequences
from training.config import TrackerTrainingConfig
from training.sampling.frames import pair_list, read_frame
from training.sampling.sample_sets import PairSamples
from training.sampling.samples import no_augmentation, pair_sample, shifted
from training.sampling.single_scan import MAX_FORWARD, MAX_YAW, ego_motion, split_scan

CLASSES = ("Car", "Van")


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    """Scans 0, 2, 3 and 5: one pair, two single scans."""
    root = write_sequence(tmp_path_factory.mktemp("gaps"), frames=6, missing=(1, 4))
    return open_sequences(root, [0], "training")


@pytest.fixture(scope="module")
def frame(sequences):
    return read_frame(sequences[0], 0, CLASSES)._replace(
        other_boxes=boxes_at(0)[:1] + 5.0, other_ids=np.array([9])
    )


def rng(seed=0):
    return np.random.default_rng(seed)


def test_single_scans_are_those_without_a_neighbour(sequences):
    assert pair_list(sequences) == [(0, 3)]
    assert pair_list(sequences, single_scans=True) == [(0, 3), (0, 0), (0, 5)]


def test_a_scan_before_a_half_sequence_is_no_neighbour(tmp_path):
    """Frames 3 to 5 of a sequence: scan 2 is there, and belongs to the other half."""
    root = write_sequence(tmp_path, frames=6, missing=(1, 4))
    seqmap = root / "training" / "evaluate_tracking.seqmap.training"
    seqmap.write_text("0000 empty 000003 000005\n")
    augmentation = dataclasses.replace(no_augmentation(), single_scan_pairs=True)
    config = TrackerTrainingConfig(augmentation=augmentation)
    samples = PairSamples(open_sequences(root, [0]), config, SMALL_DETECTOR, augmentation)
    assert samples.items == [(0, 3), (0, 5)]
    assert (samples(0, 0).foreground[0] == 1).any()  # a half of scan 3 with its labels


def test_ego_motion_drives_on_and_then_turns():
    left = ego_motion(1.5, np.pi / 2)  # points ahead are to the right afterwards
    np.testing.assert_allclose(left @ [5, 0, 0.3, 1], [0, -3.5, 0.3, 1], atol=1e-12)
    np.testing.assert_allclose(ego_motion(1.5, 0.0) @ [5, 2, 0, 1], [3.5, 2, 0, 1])


@pytest.mark.parametrize("seed", range(5))
def test_halves_hold_all_points_once(frame, seed):
    first, second = split_scan(frame, rng(seed))
    assert abs(len(first.points) - len(second.points)) <= 1
    a, b = (half.other_boxes[0, :2] for half in (first, second))
    motion = rng(seed)
    motion.permutation(len(frame.points))
    drive, turn = motion.uniform(0.0, MAX_FORWARD), motion.uniform(-MAX_YAW, MAX_YAW)
    np.testing.assert_allclose((ego_motion(drive, turn) @ [*a, 0, 1])[:2], b)
    back = np.linalg.inv(ego_motion(drive, turn))
    returned = second.points @ back[:3, :3].T + back[:3, 3]
    together = np.concatenate([first.points, returned])
    order, whole = np.lexsort(together.round(3).T), np.lexsort(frame.points.round(3).T)
    np.testing.assert_allclose(together[order], frame.points[whole], atol=2e-3)
    for half in (first, second):
        assert len(half.points) == len(half.ground) == len(half.ignored)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_labels_lead_into_the_box_of_the_other_frame(frame, seed, shift):
    augmentation = dataclasses.replace(
        no_augmentation(), object_shift=shift, object_shift_share=1.0
    )
    halves = split_scan(frame, rng(seed))
    points, displacement, foreground = pair_sample(*halves, 200, augmentation, rng(seed))
    if shift:
        halves = shifted(halves, augmentation, rng(seed))
    for here, there in ((0, 1), (1, 0)):
        owner = points_in_boxes(points[here], halves[here].boxes, margin=1e-3)
        chosen = foreground[here] == 1
        assert chosen.sum() > 15
        led = points[here] + displacement[here]
        for box in (0, 1):
            rows = chosen & (owner == box)
            target = halves[there].boxes[box].copy()
            target[6] = halves[here].boxes[box, 6]  # a label moves points, it does not turn them
            assert rows.any()
            assert (points_in_boxes(led[rows], target[None], margin=2e-3) == 0).all()
        assert not displacement[here][foreground[here] == 0].any()
    if not shift:
        moved = np.abs(displacement[0][foreground[0] == 1])
        assert 0 < moved.max() < MAX_FORWARD + 40 * MAX_YAW


def test_samples_take_single_scans_and_real_pairs(sequences):
    config, detector = TrackerTrainingConfig(), dataclasses.replace(SMALL_DETECTOR, num_points=150)
    make = PairSamples(
        sequences,
        config,
        detector,
        dataclasses.replace(config.augmentation, single_scan_pairs=True),
    )
    rows = [make.items.index(item) for item in ((0, 0), (0, 3), (0, 0))]
    samples = [make(row, 4) for row in rows]
    for sample in samples:
        assert sample.points.shape == (2, 150, 3)
        assert (sample.foreground == 1).sum() > 20
    np.testing.assert_array_equal(samples[0].points, samples[2].points)
    assert not np.array_equal(samples[0].points[0], samples[0].points[1])
