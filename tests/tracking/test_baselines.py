"""SORT's and AB3DMOT's own traits: probation, IoU gate, GIoU, the sensor's own motion."""

import numpy as np
import pytest
from helpers.fixed_context import FixedContext

from common.errors import InputError
from kitti.boxes import transform_boxes
from tracking import FrameDetections, make_tracker, track_frame

CAR = np.array([0.0, 0.0, -1.0, 4.0, 2.0, 1.5, 0.0])


def cars(*x: float) -> np.ndarray:
    return np.array([CAR + np.array([value, 0, 0, 0, 0, 0, 0]) for value in x]).reshape(-1, 7)


def step(tracker, boxes, **context):
    found = FrameDetections(0, boxes, np.ones(len(boxes)))
    return track_frame(tracker, found, FixedContext(**context))


def test_sort_reports_at_once_in_the_first_frames_and_after_three_matches_later():
    tracker = make_tracker("sort")
    assert [len(step(tracker, cars(0.0))) for _ in range(5)] == [1] * 5
    # born in frame 6: matched in frames 7, 8 and 9
    shown = [step(tracker, cars(0.0, 30.0)).ids.tolist() for _ in range(5)]
    assert shown == [[0], [0], [0], [0, 1], [0, 1]]


def test_sort_starts_probation_again_after_a_miss():
    tracker = make_tracker("sort")
    for _ in range(6):
        step(tracker, cars(0.0))
    step(tracker, cars())
    assert [len(step(tracker, cars(0.0))) for _ in range(4)] == [0, 0, 1, 1]


@pytest.mark.parametrize(("shift", "same"), [(2.1, True), (2.2, False)])
def test_sort_needs_iou_of_three_tenths(shift, same):
    # shift s along 4 m: IoU (4 - s) / (4 + s): 2.1 -> 0.311, 2.2 -> 0.290
    tracker = make_tracker("sort")
    step(tracker, cars(0.0))
    assert (step(tracker, cars(shift)).ids.tolist() == [0]) == same


def test_sort_reports_the_detection_and_ab3dmot_the_state():
    for name, moved in (("sort", 0.4), ("ab3dmot", None)):
        tracker = make_tracker(name)
        step(tracker, cars(0.0))
        x = step(tracker, cars(0.4)).boxes[0, 0]
        assert x == moved if moved else 0.39 < x < 0.4


def test_ab3dmot_reports_a_missed_object_for_one_frame():
    tracker = make_tracker("ab3dmot")
    for t in range(10):
        step(tracker, cars(0.5 * t))
    tracks = step(tracker, cars())
    assert tracks.detections.tolist() == [-1]
    assert tracks.boxes[0, 0] == pytest.approx(5.0, abs=0.02)
    assert len(step(tracker, cars())) == 0


def test_giou_matches_boxes_that_do_not_touch():
    # 4.4 m apart: IoU 0, GIoU = 0 - (8.4 - 8) / 8.4 = -0.048; 7 m: -(11 - 8) / 11 = -0.273
    for similarity, threshold, shift, same in (
        ("giou_3d", -0.2, 4.4, True),
        ("giou_3d", -0.2, 7.0, False),
        ("iou_3d", 0.01, 4.4, False),
    ):
        tracker = make_tracker("ab3dmot", similarity=similarity, min_similarity=threshold)
        step(tracker, cars(0.0))
        tracks = step(tracker, cars(shift))
        assert (tracks.ids[tracks.detections == 0].tolist() == [0]) == same


def ego_motion(turn: float, forward: float) -> np.ndarray:
    """Takes level-frame coordinates of t-1 to those of t, for a sensor that moves and turns."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[0, 3] = forward
    return np.linalg.inv(pose)


def test_ego_motion_keeps_parked_cars_apart_while_the_sensor_turns():
    parked = cars(25.0, 30.5, 36.0)
    motion = ego_motion(0.12, 1.5)  # 30 m away, 0.12 rad are 3.6 m sideways
    seen = {}
    for compensated in (True, False):
        tracker, boxes = make_tracker("ab3dmot"), parked
        for t in range(8):
            given = motion if compensated and t else None
            tracks = step(tracker, boxes, ego_motion=given)
            boxes = transform_boxes(boxes, motion)
        seen[compensated] = sorted(tracks.ids.tolist()), tracks.boxes
    assert seen[True][0] == [0, 1, 2]
    assert seen[False][0] != [0, 1, 2]
    # nothing moves in the world, so prediction and detection agree
    assert seen[True][1] == pytest.approx(transform_boxes(boxes, np.linalg.inv(motion)), abs=1e-6)


def test_bad_ego_motion_is_refused():
    with pytest.raises(InputError, match="ego_motion of shape"):
        step(make_tracker("ab3dmot"), cars(0.0), ego_motion=np.eye(3))
    with pytest.raises(InputError, match="finite ego_motion"):
        step(make_tracker("ab3dmot"), cars(0.0), ego_motion=np.full((4, 4), np.nan))


def image_boxes(*x: float) -> np.ndarray:
    return np.array([[100.0 + v, 50.0, 140.0 + v, 80.0] for v in x]).reshape(-1, 4)


def test_sort_in_image_space_follows_the_image_boxes_alone():
    tracker = make_tracker("sort", space="image")
    step(tracker, cars(0.0), image_boxes=image_boxes(0.0))
    # far away in space, next to it in the image: 20 pixels of 40 are IoU 1/3
    tracks = step(tracker, cars(40.0), image_boxes=image_boxes(20.0))
    assert tracks.ids.tolist() == [0]
    assert tracks.boxes == pytest.approx(cars(40.0))
    assert step(tracker, cars(40.0), image_boxes=image_boxes(400.0)).ids.tolist() == [1]


def test_sort_in_image_space_leaves_out_boxes_outside_the_image():
    tracker = make_tracker("sort", space="image")
    outside = np.full((1, 4), np.nan)
    tracks = step(tracker, cars(0.0, 9.0), image_boxes=np.vstack([outside, image_boxes(0.0)]))
    assert tracks.detections.tolist() == [1]
    assert len(step(tracker, cars(), image_boxes=image_boxes())) == 0


def test_image_filter_learns_a_constant_motion_and_growth():
    tracker = make_tracker("sort", space="image")
    for t in range(30):
        box = np.array([[100.0 + 3 * t, 50.0 + t, 140.0 + 3 * t, 80.0 + t]])
        tracks = step(tracker, cars(0.0), image_boxes=box)
    tracker.predict()
    assert tracks.ids.tolist() == [0]
    assert tracker.life.tracks[0].state.box == pytest.approx(box[0] + [3, 1, 3, 1], abs=0.05)


def test_sort_in_image_space_needs_image_boxes():
    with pytest.raises(InputError, match=r"sort_image: expected a FrameContext with image_boxes"):
        step(make_tracker("sort", space="image"), cars(0.0))
    with pytest.raises(InputError, match="space: expected one of level, image"):
        make_tracker("sort", space="bev")
