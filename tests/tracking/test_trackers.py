"""What holds for every tracker: hand-made scenes, empty frames, ids, input order, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from common.errors import InputError
from tracking import TRACKERS, TrueDisplacement, make_tracker

CAR = np.array([0.0, 0.0, -1.0, 4.0, 1.8, 1.5, 0.0])


def car(x: float, y: float, yaw: float = 0.0) -> np.ndarray:
    return CAR + np.array([x, y, 0, 0, 0, 0, yaw])


def run(name: str, frames: list[dict[int, np.ndarray]], order=None, **parameters):
    """Feeds label id -> box frames to a tracker; per frame, label id -> track id of matched rows.

    The two names of Algorithm 1 get the true displacement, the rest boxes alone.
    """
    tracker, given, previous = make_tracker(name, **parameters), [], None
    for t, frame in enumerate(frames):
        labels = np.array(list(frame), int)
        if order is not None:
            labels = order.permutation(labels)
        boxes = np.array([frame[i] for i in labels]).reshape(-1, 7)
        motion = None if previous is None else TrueDisplacement(*previous, boxes, labels)
        tracker.predict()
        tracks = tracker.update(
            boxes, np.ones(len(boxes)), ids=labels, box_displacement=motion, frame=t
        )
        assert tracks.boxes.shape == (len(tracks), 7)
        assert np.all(np.diff(tracks.ids) > 0)
        seen = tracks.detections >= 0
        given.append(
            dict(zip(labels[tracks.detections[seen]].tolist(), tracks.ids[seen], strict=True))
        )
        previous = boxes, labels
    return given


def ids_of(given: list[dict[int, int]], label: int) -> set[int]:
    return {int(frame[label]) for frame in given if label in frame}


def crossing(frames: int = 21) -> list[dict[int, np.ndarray]]:
    """Two cars that pass each other on neighbouring lanes at 1 m per frame each."""
    return [{5: car(t, 0.0), 9: car(20.0 - t, 3.0, np.pi)} for t in range(frames)]


@pytest.mark.parametrize("name", TRACKERS)
def test_crossing_cars_keep_their_ids(name):
    given = run(name, crossing())
    assert len(given[-1]) == 2
    assert len(ids_of(given, 5)) == len(ids_of(given, 9)) == 1
    assert ids_of(given, 5) != ids_of(given, 9)


@pytest.mark.parametrize("name", TRACKERS)
def test_ids_start_at_zero_in_each_instance_and_are_never_reused(name):
    for _ in range(2):
        given = run(name, [{1: car(0, 0)}] * 6 + [{}] * 40 + [{2: car(50, 20)}] * 6)
        assert ids_of(given, 1) == {0}
        assert ids_of(given, 2) == {1}


@pytest.mark.parametrize("name", TRACKERS)
def test_no_detections_ever(name):
    assert run(name, [{}] * 5) == [{}] * 5


@pytest.mark.parametrize("name", TRACKERS)
def test_empty_frame_reports_no_detection_and_arrays_keep_their_shape(name):
    tracker = make_tracker(name)
    tracker.predict()
    tracks = tracker.update(np.zeros((0, 7)), np.zeros(0))
    assert tracks.boxes.shape == (0, 7)
    assert tracks.ids.shape == tracks.scores.shape == tracks.detections.shape == (0,)


@pytest.mark.parametrize(
    ("name", "gap", "same"),
    [
        ("sort", 1, True),
        ("sort", 2, False),  # SORT's T_lost is 1
        ("ab3dmot", 1, True),
        ("ab3dmot", 2, False),  # Age_max is 2: the second miss is death
        ("deep_sort", 8, True),
        ("deep_sort", 31, False),  # A_max is 30
        ("gt_displacement", 1, True),
        ("gt_displacement", 12, False),
    ],
)
def test_occlusion_gap(name, gap, same):
    frames = [{1: car(0.5 * t, 0.0)} for t in range(8 + gap + 8)]
    frames[8 : 8 + gap] = [{}] * gap
    assert (len(ids_of(run(name, frames), 1)) == 1) == same


@pytest.mark.parametrize("name", ["gt_displacement", "pointtracknet"])
def test_sudden_jump_is_followed_with_displacement(name):
    frames = [{1: car(0.5 * t + 6.0 * (t >= 10), 3.0 * (t >= 10))} for t in range(16)]
    assert ids_of(run(name, frames), 1) == {0}


def test_sudden_jump_breaks_sort():
    frames = [{1: car(0.5 * t + 6.0 * (t >= 10), 3.0 * (t >= 10))} for t in range(16)]
    assert ids_of(run("sort", frames), 1) == {0, 1}


@pytest.mark.parametrize("name", TRACKERS)
def test_order_of_the_input_does_not_matter(name):
    rng = np.random.default_rng(3)
    start, speed = rng.uniform(-20, 20, (8, 2)), rng.uniform(-1, 1, (8, 2))
    frames = [
        {i: car(*(start[i] + speed[i] * t)) for i in range(8) if (t + 3 * i) % 11}
        for t in range(30)
    ]
    plain = run(name, frames)
    mixed = run(name, frames, order=np.random.default_rng(4))
    # same trajectories up to their names
    names: dict[int, int] = {}
    for one, other in zip(plain, mixed, strict=True):
        assert one.keys() == other.keys()
        assert all(names.setdefault(int(one[i]), int(other[i])) == other[i] for i in one)
    assert len(set(names.values())) == len(names) > 0


@pytest.mark.parametrize("name", TRACKERS)
@pytest.mark.parametrize(
    ("boxes", "scores", "message"),
    [
        ([[np.nan, 0, 0, 4, 2, 1, 0]], [1.0], "finite boxes.*frame 12.*row 0"),
        ([[np.inf, 0, 0, 4, 2, 1, 0]], [1.0], "finite boxes"),
        ([CAR, [0, 0, 0, 4, -2, 1, 0]], [1.0, 1.0], "positive sizes.*row 1"),
        ([CAR], [np.nan], "finite scores"),
        ([CAR], [1.0, 2.0], "expected 1 scores.*found shape"),
        ([CAR[:6]], [1.0], r"shape \(M, 7\).*found \(1, 6\)"),
    ],
)
def test_bad_detections_are_refused(name, boxes, scores, message):
    tracker = make_tracker(name)
    tracker.predict()
    with pytest.raises(InputError, match=message):
        tracker.update(np.array(boxes), np.array(scores), frame=12)


def test_make_tracker_refuses_unknown_names_and_parameters():
    with pytest.raises(InputError, match="expected a tracker among pointtracknet"):
        make_tracker("kalman")
    with pytest.raises(InputError, match=r"sort has the parameters min_iou.*found 'tau'"):
        make_tracker("sort", tau=0.5)
    with pytest.raises(InputError, match="expected one of"):
        make_tracker("ab3dmot", similarity="iou")
