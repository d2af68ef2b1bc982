"""Replay of real label files, and fidelity where there are real scans."""

import numpy as np
import pytest
from helpers import two_cars

from common.flags import run
from kitti.boxes import points_in_boxes
from kitti.sequence import KittiSequence
from simulator.drives.replay import replay
from simulator.fidelity import FrameCounts, count_beams, histogram_distance, summarise
from simulator.sensor_model.frames import Options, take_sweep
from studies import simulator_fidelity

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def world(kitti_root):
    sequence = KittiSequence(kitti_root, 16)
    return sequence, replay(sequence, np.random.default_rng(0))


def test_scene_boxes_are_the_labels(world):
    sequence, scenes = world
    for frame in (0, 50, 208):
        labels = sequence.objects.at(frame)
        labels = labels[labels.type != "DontCare"]
        np.testing.assert_array_equal(scenes.scene(frame).boxes, labels.boxes)


def test_nothing_static_where_a_labelled_object_is(world):
    sequence, scenes = world
    for frame in (5, 100):
        scene = scenes.scene(frame)
        where = (sequence.calib, sequence.image_size, Options(), (0, 16, frame))
        result = take_sweep(scene, *where)
        static = sequence.calib.velo_to_level(result.points[result.owner == -1, :3])
        assert len(static) > 1000
        assert (points_in_boxes(static, scene.boxes) == -1).all()


def test_no_wall_hides_objects_labelled_visible(world):
    sequence, scenes = world
    frame = 50
    labels = sequence.objects.at(frame)
    labels = labels[labels.type != "DontCare"]
    where = (sequence.calib, sequence.image_size, Options(), (0, 16, frame))
    result = take_sweep(scenes.scene(frame), *where)
    visible = (labels.occlusion == 0) & (result.rays > 20)
    assert visible.any()
    assert (result.seen[visible] > 0.5 * result.rays[visible]).mean() > 0.8


@pytest.mark.slow
def test_fidelity_meets_its_goals(kitti_root, tmp_path, capsys):
    flags = ["--data_root", str(kitti_root), "--out", str(tmp_path), "--every", "14", "--seeds",
             "1", "--pictures", "20"]  # fmt: skip
    assert run(simulator_fidelity.main, flags) == 0
    printed = capsys.readouterr()
    assert "points per vehicle, Spearman" in printed.out
    assert "goals missed: none" in printed.err
    assert (tmp_path / "fidelity.json").stat().st_size > 500
    assert (tmp_path / "fidelity.png").stat().st_size > 10000


def test_fidelity_needs_scans(tmp_path, capsys):
    two_cars.write_sequence(tmp_path, 0, frames=2, missing=(0, 1))
    two_cars.write_sequence(tmp_path, 1, frames=2)
    flags = ["--data_root", str(tmp_path), "--out", str(tmp_path / "out")]
    assert run(simulator_fidelity.main, flags) == 2
    assert "found none" in capsys.readouterr().err
    assert run(simulator_fidelity.main, [*flags, "--seq", "1"]) == 2
    assert "--pictures: expected frames with scans, found 20" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_fidelity_figures():
    rings = [
        (10 * np.cos(a), 10 * np.sin(a), 0.2 + 10 * np.tan(np.radians(e)))
        for e in (-1.0, -1.4, -2.5)
        for a in (0.0, 0.01, 0.02)
    ]
    assert count_beams(np.array(rings)) == 3 and count_beams(np.zeros((0, 3))) == 0
    assert histogram_distance(np.array([2, 0]), np.array([0, 5])) == 1
    assert histogram_distance(np.array([1, 1]), np.array([2, 2])) == 0


def test_frames_and_boxes_of_several_worlds_count_once():
    ones = np.ones((2, 3))
    boxes = (np.array([5.0, 20.0, 40.0]), np.array([[30, 40], [20, 20], [5, 9]]), np.ones((3, 2)))
    frame = FrameCounts(np.array([100, 90]), ones, ones, *boxes)
    rows = summarise([[frame] * 4] * 3)
    assert rows["frames"] == 4 and rows["random worlds"] == 3 and rows["vehicle boxes"] == 8
    assert rows["points per vehicle 0-15 m, boxes"] == 4
    assert rows["points per vehicle 30-50 m, boxes"] == 0
    assert rows["points per frame, ratio"] == pytest.approx(0.9)
