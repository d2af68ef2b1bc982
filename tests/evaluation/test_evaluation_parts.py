"""Scene, sources, tracking loop and tables, one by one."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers import tiny_kitti, two_cars

from common.markdown import markdown
from evaluation.config import NETWORK, EvaluateConfig
from evaluation.detections import DetectionFiles, LabelBoxes, NetworkStream
from evaluation.run import run_tracker
from evaluation.scene import Scene
from evaluation.tracking_loop import NEVER_SEEN, SceneFrame, keep_last_seen, track_scene
from kitti.object_shift import ObjectShift
from kitti.sequence import KittiSequence
from tracking import make_tracker, track_frame


@pytest.fixture
def scene(tiny_root) -> Scene:
    return Scene(KittiSequence(tiny_root, 0))


def test_ground_truth_gives_every_frame_even_empty_ones(tiny_root):
    empty = Scene(KittiSequence(tiny_root, 1))
    frames = list(LabelBoxes(("Car",)).frames(empty))
    assert [found.t for found in frames] == [0, 1, 2, 3, 4]
    assert all(found.boxes.shape == (0, 7) for found in frames)


def test_ground_truth_boxes_are_the_displaced_labels(tiny_root):
    moved = Scene(KittiSequence(tiny_root, 0), ObjectShift(2.0, seed=3))
    still = Scene(KittiSequence(tiny_root, 0))
    for found in LabelBoxes(("Car", "Van")).frames(moved):
        gap = np.linalg.norm(found.boxes[:, :3] - still.objects.at(found.t).boxes[:, :3], axis=1)
        assert (gap <= 2.0).all() and (gap > 0).all()
        assert (found.scores == 1).all() and len(found.types) == len(found)


def test_detections_carry_scores_and_types(tiny_root, scene):
    provider = DetectionFiles(tiny_root / "detections", [scene], ("Car",))
    found = next(provider.frames(scene))
    assert found.boxes.shape == (2, 7) and found.scores.tolist() == [5, 5]
    assert found.types.tolist() == ["Car", "Car"]


def test_ego_motion_takes_the_frame_before_to_this_one(tmp_path):
    root = tiny_kitti.make(tmp_path / "kitti")
    poses = np.tile(np.eye(4)[:3], (12, 1, 1))
    poses[:, 2, 3] = 1.5 * np.arange(12)  # the camera drives 1.5 m ahead in each frame
    (root / "poses").mkdir()
    np.savetxt(root / "poses" / "0000.txt", poses.reshape(12, 12))
    motions = Scene(KittiSequence(root, 0)).ego_motions
    np.testing.assert_allclose(motions[0], np.eye(4), atol=1e-12)
    ahead = motions[5] @ [10.0, 0, 0, 1]  # a point 10 m ahead before is now 8.5 m ahead
    np.testing.assert_allclose(ahead, [8.5, 0, 0, 1], atol=1e-12)


def test_ego_motion_is_known_where_there_are_poses(tmp_path, scene):
    root = tiny_kitti.make(tmp_path / "kitti")
    (root / "poses").mkdir()
    np.savetxt(root / "poses" / "0000.txt", np.tile(np.eye(4)[:3].ravel(), (12, 1)))
    with_poses = Scene(KittiSequence(root, 0))
    np.testing.assert_array_equal(
        SceneFrame(with_poses, with_poses.objects, 3).ego_motion, np.eye(4)
    )
    assert SceneFrame(scene, scene.objects, 3).ego_motion is None


def test_true_motion_is_the_labels(scene):
    objects = scene.objects
    motion = SceneFrame(scene, objects.of_classes(("Car", "Van")), 1).label_motion
    assert motion.ids_of(objects.at(1).boxes).tolist() == objects.at(1).track_id.tolist()
    moved = motion.displacement(objects.at(0).track_id)
    np.testing.assert_allclose(moved, np.tile([0.4, 0, 0], (3, 1)), atol=1e-5)


def test_types_follow_the_detections(scene):
    tracker = make_tracker("gt_displacement")
    rows = track_scene(scene, LabelBoxes(("Car", "Van")), tracker, ("Car", "Van"))
    van = rows[rows.type == "Van"]
    assert len(van) == 12 and len(set(van.track_id.tolist())) == 1


def test_a_track_outside_the_image_keeps_its_last_image_box():
    bbox = np.array([[1, 2, 3, 4], [np.nan] * 4, [np.nan] * 4, [5, 6, 7, 8.0]])
    kept = keep_last_seen(np.array([7, 7, 8, 7]), bbox)
    assert kept.tolist() == [[1, 2, 3, 4], [1, 2, 3, 4], [NEVER_SEEN] * 4, [5, 6, 7, 8]]


def _seen(*x: float):
    """State of a frame with a car and a foreground point at each x; no points at all without."""
    boxes = np.array([[at, 0, -1, 4, 2, 1.5, 0] for at in x]).reshape(-1, 7)
    found = SimpleNamespace(boxes=boxes, scores=np.ones(len(x)), classes=np.zeros(len(x), int))
    return SimpleNamespace(points=boxes[:, :3], foreground=np.ones(len(x)), detections=found)


def test_a_frame_without_a_scan_leaves_the_displacement_unknown():
    """A car that moves by 5 m in each frame is found again after the gap."""
    config = SimpleNamespace(box=SimpleNamespace(classes=("Car",)))
    network = SimpleNamespace(
        detector=SimpleNamespace(config=config),
        displacement=lambda before, after: np.full_like(before.points, 5.0) * [1, 0, 0],
    )
    stream, tracker = NetworkStream(network), make_tracker("pointtracknet")
    ids = []
    for t, state in enumerate((_seen(0.0), _seen(5.0), _seen(), _seen(15.0))):
        found = stream.follow(state, t)
        ids.append(track_frame(tracker, found).ids.tolist())
        assert found.points is None if t == 0 else len(found.points) == (t == 1)
    assert ids == [[0], [0], [], [0]]


def test_boxes_of_the_networks_are_tracked_if_they_are_of_the_classes(tmp_path, capsys):
    two_cars.write_sequence(tmp_path, 0, frames=2)

    def tracked(kind):
        chosen = {"classes": (kind,), "detections": NETWORK, "tracker": "sort"}
        config = EvaluateConfig(tmp_path, seqs=(0,), protocols=(), **chosen)
        return len(run_tracker(config, config.open_scenes(), LabelBoxes(("Car",)))["0000"])

    assert tracked("Car") > 0 and "no box is of" not in capsys.readouterr().err
    assert tracked("Pedestrian") == 0
    assert "no box is of --classes Pedestrian, all are Car" in capsys.readouterr().err


def test_table_shows_a_dash_for_none():
    text = markdown(["protocol", "MOTA", "GT"], [["clear3d", None, 12], ["kitti2d", 0.5, 3]])
    assert text.splitlines() == [
        "| protocol |   MOTA |  GT |",
        "| -------- | -----: | --: |",
        "| clear3d  |      - |  12 |",
        "| kitti2d  | 0.5000 |   3 |",
    ]
