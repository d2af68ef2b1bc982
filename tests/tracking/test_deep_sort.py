"""DEEP_SORT: cascade, gate, appearance."""

import numpy as np
import pytest

from common.errors import InputError
from tracking import FrameDetections, make_tracker, track_frame
from tracking.kalman_box import Noise

CAR = np.array([0.0, 0.0, -1.0, 4.0, 1.8, 1.5, 0.0])
RED, BLUE = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def cars(*x: float) -> np.ndarray:
    return np.array([CAR + np.array([value, 0, 0, 0, 0, 0, 0]) for value in x]).reshape(-1, 7)


def step(tracker, *x: float, looks=None):
    appearance = None if looks is None else np.array(looks).reshape(len(x), -1)
    found = FrameDetections(0, cars(*x), np.ones(len(x)), appearance=appearance)
    return track_frame(tracker, found)


def found(tracks) -> list[int]:
    """Ids of the tracks that were matched."""
    return tracks.ids[tracks.detections >= 0].tolist()


def settled(*x: float, looks=None, **parameters):
    """A tracker with confirmed, standing tracks 0, 1... at `x`."""
    tracker = make_tracker("deep_sort", **parameters)
    for _ in range(6):
        step(tracker, *x, looks=looks)
    return tracker


def test_tracks_are_tentative_for_three_frames_and_die_at_the_first_miss():
    tracker = make_tracker("deep_sort")
    assert [len(step(tracker, 0.0)) for _ in range(3)] == [0, 0, 1]
    tracker = make_tracker("deep_sort")
    step(tracker, 0.0)
    step(tracker)
    step(tracker, 0.0)
    step(tracker, 0.0)
    assert step(tracker, 0.0).ids.tolist() == [1]


def test_cascade_prefers_the_track_seen_more_recently():
    # both tracks stood within the gate of the detection; the old one stood exactly there
    tracker = settled(0.0, 1.0)
    for _ in range(3):
        step(tracker, 1.0)  # track 1 is seen on, track 0 is lost
    assert found(step(tracker, 0.2)) == [1]


def test_the_authors_code_reports_a_track_for_one_frame_after_its_last_match_at_its_prediction():
    tracker = make_tracker("deep_sort_published")
    for t in range(6):
        step(tracker, 0.5 * t)
    tracks = step(tracker)
    assert tracks.detections.tolist() == [-1]
    np.testing.assert_allclose(tracks.boxes, cars(3.0), atol=0.1)
    assert len(step(tracker)) == 0
    assert len(step(settled(0.0))) == 0  # the default: never


def test_a_frame_without_appearance_among_others_goes_by_distance():
    tracker = settled(0.0, 20.0, looks=[RED, BLUE])
    assert found(step(tracker, 0.1, 20.1)) == [0, 1]


def test_without_the_age_order_the_nearer_track_is_taken():
    tracker = settled(0.0, 1.0)
    assert found(step(tracker, 0.2)) == [0]


def test_appearance_beats_distance_within_the_gate():
    tracker = settled(0.0, 0.6, looks=[RED, BLUE])
    # each detection lies where the other car stood
    tracks = step(tracker, 0.0, 0.6, looks=[BLUE, RED])
    assert dict(zip(tracks.ids.tolist(), tracks.detections.tolist(), strict=True)) == {0: 1, 1: 0}


def test_gate_refuses_a_look_alike_far_away():
    tracker = settled(0.0, looks=[RED])
    assert found(step(tracker, 60.0, looks=[RED])) == []  # a new, tentative track
    assert [track.id for track in tracker.life.tracks] == [0, 1]


def test_other_looks_are_refused_in_the_cascade_and_accepted_by_iou():
    tracker = settled(0.0, looks=[RED])
    assert step(tracker, 0.1, looks=[BLUE]).ids.tolist() == [0]  # IoU, missed for one frame only
    tracker = settled(0.0, looks=[RED])
    step(tracker)
    assert found(step(tracker, 0.1, looks=[BLUE])) == []  # two frames: no IoU stage


def test_gallery_remembers_every_look():
    tracker = settled(0.0, looks=[RED])
    step(tracker, 0.0, looks=[BLUE])
    step(tracker)
    assert step(tracker, 0.0, looks=[RED]).ids.tolist() == [0]
    tracker = settled(0.0, looks=[RED], gallery_size=1)
    step(tracker, 0.0, looks=[BLUE])  # red is forgotten
    step(tracker)
    assert len(step(tracker, 0.0, looks=[RED])) == 0


def test_rows_of_zeros_have_no_appearance_and_go_by_distance():
    tracker = settled(0.0, 20.0, looks=[RED, BLUE])
    tracks = step(tracker, 0.1, 20.1, looks=[[0, 0], [0, 0]])
    assert tracks.detections.tolist() == [0, 1]


@pytest.mark.parametrize(("shift", "found"), [(0.9, True), (4.0, False)])
def test_gate_is_as_wide_as_the_noise(shift, found):
    tracker = settled(0.0)
    step(tracker)
    assert (len(step(tracker, shift)) == 1) == found


def test_wider_noise_opens_the_gate():
    tracker = settled(0.0, noise=Noise())  # SORT's, in metres
    step(tracker)
    assert len(step(tracker, 4.0)) == 1


def test_bad_appearance_is_refused():
    with pytest.raises(InputError, match="appearance of shape"):
        FrameDetections(0, cars(0.0), np.ones(1), appearance=np.zeros((2, 4)))
    with pytest.raises(InputError, match="finite appearance"):
        FrameDetections(0, cars(0.0), np.ones(1), appearance=np.full((1, 4), np.nan))
