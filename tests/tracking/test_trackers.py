"""Properties of every tracker: hand-made scenes, empty frames, ids, input order, bad input."""

import subprocess
import sys

import numpy as np
import pytest

from common.errors import InputError
from common.provenance import ROOT
from tracking import (
    TRACKERS,
    FrameContext,
    FrameDetections,
    LabelMotion,
    make_tracker,
    track_frame,
)

CAR = np.array([0.0, 0.0, -1.0, 4.0, 1.8, 1.5, 0.0])


def car(x: float, y: float, yaw: float = 0.0) -> np.ndarray:
    return CAR + np.array([x, y, 0, 0, 0, 0, yaw])


class FromAbove(FrameContext):
    """The label motion, and an image taken from above at 10 pixels a metre."""

    def __init__(self, label_motion: LabelMotion | None = None):
        self.label_motion = label_motion

    def image_boxes(self, boxes):
        """x, y and the size along the axes, heading left out."""
        centre, half = 10 * boxes[:, :2], 5 * boxes[:, 3:5]
        return np.concatenate([centre - half, centre + half], axis=1)


def run(name: str, frames: list[dict[int, np.ndarray]], order=None, **parameters):
    """Feeds label id -> box frames to a tracker; per frame, label id -> track id of matched rows.

    The network's points are the centres of the boxes of t-1, with the labels' motion.
    """
    tracker, given, previous = make_tracker(name, **parameters), [], None
    for t, frame in enumerate(frames):
        labels = np.array(list(frame), int)
        if order is not None:
            labels = order.permutation(labels)
        boxes = np.array([frame[i] for i in labels]).reshape(-1, 7)
        motion, predicted = None, {}
        if previous is not None:
            motion = LabelMotion(*previous, boxes, labels)
            displacement = motion.displacement(previous[1])
            known = np.isfinite(displacement).all(axis=1)
            predicted = {
                "points": previous[0][known, :3],
                "displacement": displacement[known],
            }
        found = FrameDetections(t, boxes, np.ones(len(boxes)), label_ids=labels, **predicted)
        tracks = track_frame(tracker, found, FromAbove(motion))
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
    found = FrameDetections(0, np.zeros((0, 7)), np.zeros(0))
    tracks = track_frame(make_tracker(name), found, FromAbove())
    assert tracks.boxes.shape == (0, 7)
    assert tracks.ids.shape == tracks.scores.shape == tracks.types.shape == (0,)
    assert tracks.detections.shape == (0,)


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
def test_bad_detections_are_refused(boxes, scores, message):
    with pytest.raises(InputError, match=message):
        FrameDetections(12, np.array(boxes), np.array(scores))


def test_make_tracker_refuses_unknown_names_and_parameters():
    with pytest.raises(InputError, match="expected a tracker among pointtracknet"):
        make_tracker("kalman")
    with pytest.raises(InputError, match=r"sort has the parameters min_iou.*found 'tau'"):
        make_tracker("sort", tau=0.5)
    with pytest.raises(InputError, match="expected one of"):
        make_tracker("ab3dmot", similarity="iou")


def test_importing_the_trackers_leaves_the_slow_packages_for_later():
    """filterpy and scipy are needed by baselines alone; they take a second to import."""
    code = "import sys, tracking; print({'filterpy', 'scipy', 'tensorflow'} & set(sys.modules))"
    run = subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True
    )
    assert (run.stdout.strip(), run.stderr) == ("set()", "")
