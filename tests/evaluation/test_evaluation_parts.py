"""Scene, sources, tracking loop and tables, one by one."""

import numpy as np
import pytest
import tiny_kitti

from evaluation.scene import Scene
from evaluation.sources import DetectionFiles, GroundTruthBoxes
from evaluation.table import markdown
from evaluation.tracking_loop import NEVER_SEEN, Cues, keep_last_seen, track_scene
from kitti.object_shift import ObjectShift
from kitti.sequence import Sequence


@pytest.fixture
def scene(tiny_root) -> Scene:
    return Scene(Sequence(tiny_root, 0))


def test_ground_truth_gives_every_frame_even_empty_ones(tiny_root):
    empty = Scene(Sequence(tiny_root, 1))
    frames = list(GroundTruthBoxes(("Car",)).frames(empty))
    assert [t for t, *_ in frames] == [0, 1, 2, 3, 4]
    assert all(boxes.shape == (0, 7) for _, boxes, _, _ in frames)


def test_ground_truth_boxes_are_the_displaced_labels(tiny_root):
    moved = Scene(Sequence(tiny_root, 0), ObjectShift(2.0, seed=3))
    still = Scene(Sequence(tiny_root, 0))
    for t, boxes, scores, extras in GroundTruthBoxes(("Car", "Van")).frames(moved):
        gap = np.linalg.norm(boxes[:, :3] - still.objects.at(t).boxes[:, :3], axis=1)
        assert (gap <= 2.0).all() and (gap > 0).all()
        assert (scores == 1).all() and len(extras["types"]) == len(boxes)


def test_detections_carry_scores_and_types(tiny_root, scene):
    source = DetectionFiles(tiny_root / "detections", [scene], ("Car",))
    _, boxes, scores, extras = next(iter(source.frames(scene)))
    assert boxes.shape == (2, 7) and scores.tolist() == [5, 5]
    assert extras["types"].tolist() == ["Car", "Car"]


def test_ego_motion_takes_the_frame_before_to_this_one(tmp_path):
    root = tiny_kitti.make(tmp_path / "kitti")
    poses = np.tile(np.eye(4)[:3], (12, 1, 1))
    poses[:, 2, 3] = 1.5 * np.arange(12)  # the camera drives 1.5 m ahead in each frame
    (root / "poses").mkdir()
    np.savetxt(root / "poses" / "0000.txt", poses.reshape(12, 12))
    motions = Scene(Sequence(root, 0)).ego_motions
    np.testing.assert_allclose(motions[0], np.eye(4), atol=1e-12)
    ahead = motions[5] @ [10.0, 0, 0, 1]  # what stood 10 m ahead is now 8.5 m ahead
    np.testing.assert_allclose(ahead, [8.5, 0, 0, 1], atol=1e-12)


def test_ego_motion_reaches_ab3dmot_alone(tmp_path, scene):
    root = tiny_kitti.make(tmp_path / "kitti")
    (root / "poses").mkdir()
    np.savetxt(root / "poses" / "0000.txt", np.tile(np.eye(4)[:3].ravel(), (12, 1)))
    boxes = np.zeros((0, 7))
    with_poses = Scene(Sequence(root, 0))
    assert set(Cues("ab3dmot", with_poses, ("Car",)).at(0, boxes, {})) == {"ego_motion"}
    assert Cues("ab3dmot", scene, ("Car",)).at(0, boxes, {}) == {}
    assert Cues("sort", with_poses, ("Car",)).at(0, boxes, {}) == {}


def test_true_motion_is_the_labels(scene):
    cues = Cues("gt_displacement", scene, ("Car", "Van"))
    objects = scene.objects
    cues.at(0, objects.at(0).boxes, {})
    given = cues.at(1, objects.at(1).boxes, {})
    assert given["ids"].tolist() == objects.at(1).track_id.tolist()
    moved = given["box_displacement"](objects.at(0).boxes, objects.at(0).track_id)
    np.testing.assert_allclose(moved, np.tile([0.4, 0, 0], (3, 1)), atol=1e-5)


def test_types_follow_the_detections(scene):
    rows = track_scene(scene, GroundTruthBoxes(("Car", "Van")), "gt_displacement", ("Car", "Van"))
    van = rows[rows.type == "Van"]
    assert len(van) == 12 and len(set(van.track_id.tolist())) == 1


def test_a_track_outside_the_image_keeps_its_last_image_box():
    bbox = np.array([[1, 2, 3, 4], [np.nan] * 4, [np.nan] * 4, [5, 6, 7, 8.0]])
    kept = keep_last_seen(np.array([7, 7, 8, 7]), bbox)
    assert kept.tolist() == [[1, 2, 3, 4], [1, 2, 3, 4], [NEVER_SEEN] * 4, [5, 6, 7, 8]]


def test_table_shows_a_dash_for_none():
    text = markdown(["protocol", "MOTA", "GT"], [["clear3d", None, 12], ["kitti2d", 0.5, 3]])
    assert text.splitlines() == [
        "| protocol |   MOTA |  GT |",
        "| -------- | -----: | --: |",
        "| clear3d  |      - |  12 |",
        "| kitti2d  | 0.5000 |   3 |",
    ]
