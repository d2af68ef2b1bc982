"""Algorithm 1: displacement of the points in a box, one-to-one matching, lost objects."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.fixed_context import FixedContext

from common.errors import InputError
from tracking import FrameDetections, make_tracker, track_frame
from tracking.association_to_trajectory import mean_displacement

CAR = np.array([0.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0])


def cars(*x: float) -> np.ndarray:
    return np.array([CAR + np.array([value, 0, 0, 0, 0, 0, 0]) for value in x]).reshape(-1, 7)


def step(tracker, boxes, label_motion=None, scores=None, **fields):
    scores = np.ones(len(boxes)) if scores is None else scores
    found = FrameDetections(0, boxes, scores, **fields)
    return track_frame(tracker, found, FixedContext(label_motion=label_motion))


def test_mean_displacement_is_over_the_points_in_the_box_alone():
    points = np.array([[0.0, 0, -1], [1.0, 0.5, -1], [30.0, 0, -1], [0.0, 0, 5.0]])
    displacement = np.array([[1.0, 0, 0], [2.0, 0.5, 0], [9.0, 9, 9], [8.0, 8, 8]])
    mean = mean_displacement(points, displacement, cars(0.0, 30.0, 60.0))
    assert mean[0] == pytest.approx([1.5, 0.25, 0.0])
    assert mean[1] == pytest.approx([9.0, 9.0, 9.0])
    assert np.isnan(mean[2]).all()


def test_a_point_in_two_boxes_counts_in_both():
    mean = mean_displacement(np.array([[1.0, 0, -1]]), np.array([[0.5, 0, 0]]), cars(0.0, 2.0))
    assert mean == pytest.approx(np.array([[0.5, 0, 0], [0.5, 0, 0]]))


def test_points_carry_a_box_past_its_own_length():
    tracker = make_tracker("pointtracknet_no_probation")
    step(tracker, cars(0.0))
    points, displacement = np.array([[0.5, 0, -1]]), np.array([[10.0, 0, 0]])
    tracks = step(tracker, cars(10.2), points=points, displacement=displacement)
    assert tracks.ids.tolist() == [0]
    assert tracks.boxes == pytest.approx(cars(10.2))  # the detection itself, not the moved box


def test_without_displacement_the_same_jump_is_a_new_object():
    tracker = make_tracker("pointtracknet_no_probation")
    step(tracker, cars(0.0))
    assert step(tracker, cars(10.2)).ids.tolist() == [1]


def test_the_larger_iou_wins_a_conflict():
    # both old boxes prefer the new box at 1.0: IoU of a 1.0 m shift 3/5, of a 0.4 m shift 3.6/4.4
    tracker = make_tracker("pointtracknet_published", tau=0.1)
    step(tracker, cars(0.0, 1.4))
    tracks = step(tracker, cars(1.0))
    assert tracks.ids.tolist() == [1]
    # the unmatched track is kept as lost, and is found again
    tracks = step(tracker, cars(0.0, 1.4))
    assert tracks.ids.tolist() == [0, 1]
    assert tracks.detections.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("name", "ids"), [("pointtracknet_no_probation", [0, 0]), ("pointtracknet_published", [1, 0])]
)
def test_two_tracks_on_one_vehicle_become_the_older_one(name, ids):
    tracker = make_tracker(name)
    for boxes in (cars(0.0), cars(0.0), cars(0.0, 0.2)):  # the last one has two boxes on it
        tracks = step(tracker, boxes)
    assert tracks.ids.tolist() == [0, 1]
    assert [step(tracker, cars(x)).ids.tolist()[0] for x in (0.2, 0.0)] == ids
    assert len(tracker.life.tracks) == len(set(ids))


def test_the_matched_track_goes_on_where_it_is_the_older_one():
    tracker = make_tracker("pointtracknet_no_probation")
    for boxes in (cars(0.0), cars(0.0, 0.2), cars(0.0)):
        assert step(tracker, boxes).ids.tolist()[0] == 0
    assert [track.id for track in tracker.life.tracks] == [0]


@pytest.mark.parametrize("least", [0.7, 0.0])
def test_a_lost_neighbour_is_no_duplicate(least):
    """Two cars of IoU 3 / 5, and of 0 where any overlap makes a duplicate."""
    tracker = make_tracker("pointtracknet_no_probation", lost_frames=0, duplicate_iou=least)
    if least == 0:
        step(tracker, cars(0.0, 8.0))
        step(tracker, cars(0.0))
        assert [track.id for track in tracker.life.tracks] == [0, 1]
        return
    step(tracker, cars(0.0, 1.0))  # IoU 3 / 5
    step(tracker, cars(0.0))
    assert [track.id for track in tracker.life.tracks] == [0, 1]
    assert step(tracker, cars(0.0, 1.0)).ids.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("name", "parameters", "shift", "matched"),
    [
        # shift s along 4 m: IoU and GIoU (4 - s) / (4 + s), the IoU of boxes apart is 0
        ("pointtracknet_published", {"tau": 1.0 / 3.0}, 1.9, True),  # 2.1 / 5.9 = 0.356
        ("pointtracknet_published", {"tau": 1.0 / 3.0}, 2.1, False),  # 1.9 / 6.1 = 0.311
        ("pointtracknet_published", {}, 3.9, True),  # 0.1 / 7.9 = 0.0127
        ("pointtracknet_published", {}, 3.95, False),  # 0.05 / 7.95 = 0.0063
        ("pointtracknet_no_probation", {}, 9.2, True),  # -5.2 / 13.2 = -0.394
        ("pointtracknet_no_probation", {}, 9.5, False),  # -5.5 / 13.5 = -0.407
        ("pointtracknet_no_probation", {"tau": -1.0}, 90.0, True),
    ],
)
def test_a_match_has_a_similarity_above_tau(name, parameters, shift, matched):
    tracker = make_tracker(name, **parameters)
    step(tracker, cars(0.0))
    assert (step(tracker, cars(shift)).ids.tolist() == [0]) == matched


def test_boxes_apart_never_match_even_with_a_tau_of_0():
    tracker = make_tracker("pointtracknet_published", tau=0.0)
    step(tracker, cars(0.0))
    assert step(tracker, cars(4.5)).ids.tolist() == [1]


def test_boxes_that_overlap_come_before_those_apart():
    """A displacement off by 6 m and one off by 1 m compete for a box; the other box is left."""
    tracker = make_tracker("pointtracknet_no_probation")
    step(tracker, cars(-6.0, 1.0))
    assert step(tracker, cars(0.0, -12.0)).detections.tolist() == [1, 0]


def test_a_lost_object_repeats_its_last_displacement():
    tracker = make_tracker("pointtracknet_no_probation", max_age=2)
    step(tracker, cars(0.0))
    points, displacement = np.array([[0.0, 0, -1]]), np.array([[5.0, 0, 0]])
    step(tracker, cars(5.0), points=points, displacement=displacement)
    nothing = {"points": np.zeros((0, 3)), "displacement": np.zeros((0, 3))}
    assert len(step(tracker, cars(), **nothing)) == 0
    assert len(step(tracker, cars(), **nothing)) == 0
    assert step(tracker, cars(20.0), **nothing).ids.tolist() == [0]


def test_lost_object_follows_the_points_still_inside_its_moved_box():
    tracker = make_tracker("pointtracknet_no_probation", max_age=2)
    step(tracker, cars(0.0))
    there = {"points": np.array([[0.0, 0, -1]]), "displacement": np.array([[3.0, 0, 0]])}
    step(tracker, cars(), **there)  # lost, now at 3
    there = {"points": np.array([[3.0, 0, -1]]), "displacement": np.array([[0.0, 6.0, 0]])}
    found = cars(3.0)
    found[0, 1] = 6.0
    assert step(tracker, found, **there).ids.tolist() == [0]


def test_lost_object_dies_after_max_age():
    tracker = make_tracker("pointtracknet_no_probation", max_age=1)
    step(tracker, cars(0.0))
    step(tracker, cars())
    step(tracker, cars())
    assert step(tracker, cars(0.0)).ids.tolist() == [1]


MOVED = {"points": np.array([[0.0, 0, -1]]), "displacement": np.array([[3.0, 0, 0]])}
SEEN = np.array([[2.0, 0, -1], [3.0, 0, -1], [4.0, 0, -1]])  # in the box that moved to 3


def lost(after=3, boxes=(), mask=SEEN, **parameters):
    """The tracks where a vehicle at 0 is not found in its frame `after`, moved by 3 m."""
    tracker = make_tracker("pointtracknet_no_probation", **parameters)
    for _ in range(after):
        step(tracker, cars(0.0))
    return tracker, step(tracker, cars(*boxes), **MOVED, mask=mask)


def test_a_missed_vehicle_in_the_mask_is_reported_for_one_frame():
    tracker, tracks = lost()
    assert tracks.boxes == pytest.approx(cars(3.0))
    assert (tracks.ids.tolist(), tracks.detections.tolist()) == ([0], [-1])
    assert len(step(tracker, cars(), mask=SEEN)) == 0
    assert step(tracker, cars(3.0), mask=SEEN).ids.tolist() == [0]


def test_a_lost_object_is_reported_on_evidence_alone():
    assert len(lost(mask=None)[1]) == 0
    assert len(lost(mask=SEEN[:2])[1]) == 0
    assert len(lost(mask=np.add(SEEN, [20, 0, 0]))[1]) == 0
    assert len(lost(after=2)[1]) == 0  # perhaps a false box
    assert len(lost(lost_frames=0)[1]) == 0
    assert len(lost(mask=None, lost_points=0)[1]) == 1


def test_a_lost_object_behind_a_detected_one_is_not_reported():
    tracker = make_tracker("pointtracknet_no_probation")
    for _ in range(3):
        step(tracker, cars(0.0, 4.5))
    tracks = step(tracker, cars(4.5), **MOVED, mask=SEEN)  # the moved box, at 3, overlaps it
    assert tracks.ids.tolist() == [1]


def test_probation_and_start_score():
    tracker = make_tracker("pointtracknet_no_probation", min_hits=2, min_start_score=0.5)
    assert len(step(tracker, cars())) == len(step(tracker, cars())) == 0
    assert len(step(tracker, cars(0.0, 20.0), scores=[0.9, 0.4])) == 0
    tracks = step(tracker, cars(0.0, 20.0), scores=[0.3, 0.4])
    assert tracks.ids.tolist() == [0]  # a weak detection may go on, but not start
    assert tracks.scores.tolist() == [0.3]


def test_the_probation_of_ab3dmot():
    """In the first three frames every track is shown, later one from its third detection on."""
    tracker = make_tracker("pointtracknet")
    shown = [step(tracker, cars(0.0)).ids.tolist() for _ in range(3)]
    shown += [step(tracker, cars(0.0, 20.0)).ids.tolist() for _ in range(3)]
    assert shown == [[0], [0], [0], [0], [0], [0, 1]]


def test_in_its_probation_a_track_matches_only_a_box_that_overlaps_it():
    apart, near = cars(0.0, 6.0), cars(0.0, 1.0)  # GIoU -0.2 and 0.6
    shown = {}
    for name in ("pointtracknet_no_probation", "pointtracknet"):
        for case, second in (("apart", apart), ("near", near)):
            tracker = make_tracker(name)
            for _ in range(3):
                step(tracker, cars(40.0))
            tracks = [step(tracker, np.r_[cars(40.0), second[i % 2 : i % 2 + 1]]) for i in range(3)]
            shown[name, case] = tracks[-1].ids.tolist()
    assert (
        shown["pointtracknet_no_probation", "apart"]
        == shown["pointtracknet_no_probation", "near"]
        == [0, 1]
    )
    assert shown["pointtracknet", "near"] == [0, 1]
    assert shown["pointtracknet", "apart"] == [0]
    tracker = make_tracker("pointtracknet")
    for _ in range(3):
        step(tracker, cars(0.0))
    assert step(tracker, cars(6.0)).ids.tolist() == [0]  # past its probation


def test_unknown_box_displacement_falls_back_to_the_last_one():
    tracker = make_tracker("gt_displacement")
    step(tracker, cars(0.0), label_ids=[4])
    requested = []

    def known(ids):
        requested.append(ids.tolist())
        return np.array([[5.0, 0, 0]])

    step(tracker, cars(5.0), SimpleNamespace(displacement=known), label_ids=[4])
    unknown = SimpleNamespace(displacement=lambda ids: np.full((1, 3), np.nan))
    tracks = step(tracker, cars(10.0), unknown, label_ids=[4])
    assert tracks.ids.tolist() == [0]
    assert requested == [[4]]


@pytest.mark.parametrize(
    ("points", "displacement", "message"),
    [
        (np.zeros((2, 3)), np.zeros((3, 3)), "displacement"),
        (np.zeros((2, 3)), np.zeros((2, 2)), "displacement"),
        (np.full((1, 3), np.nan), np.zeros((1, 3)), "finite points"),
        (np.zeros((1, 3)), np.full((1, 3), np.inf), "finite displacement"),
        (np.zeros(3), np.zeros((1, 3)), "points of shape"),
    ],
)
def test_bad_points_are_refused(points, displacement, message):
    tracker = make_tracker("pointtracknet_no_probation")
    with pytest.raises(InputError, match=message):
        step(tracker, cars(0.0), points=points, displacement=displacement)


def test_points_without_displacement_are_refused():
    with pytest.raises(InputError, match="displacement"):
        step(make_tracker("pointtracknet_no_probation"), cars(0.0), points=np.zeros((2, 3)))


def test_background_points_do_not_slow_a_box_down():
    """Foreground moves by 2 m; the ground within the box is kept, and trained towards 0."""
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 0, -0.7]])
    displacement = np.array([[2.0, 0, 0], [2.0, 0, 0], [0.0, 0, 0]])
    box = np.array([[0.0, 0, 0, 4, 2, 1.5, 0]])
    mean = mean_displacement(points, displacement, box, [0.9, 0.5, 0.1])
    np.testing.assert_array_equal(mean, [[2.0, 0, 0]])
    assert mean_displacement(points, displacement, box)[0, 0] == pytest.approx(4 / 3)
    mean = mean_displacement(points, displacement, box, [0.4, 0.3, 0.1])  # no foreground: all
    assert mean[0, 0] == pytest.approx(4 / 3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tau", np.nan),
        ("tau", 1.1),
        ("tau", -1.1),
        ("similarity", "iou"),
        ("max_age", -1),
        ("min_hits", 0),
        ("min_start_score", np.nan),
    ],
)
def test_parameters_out_of_range_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name}: expected"):
        make_tracker("pointtracknet_no_probation", **{name: value})
