"""The demo's own path on a tiny configuration: whole, interrupted, repeated, with bad input."""

import json
import re

import numpy as np
import pytest
from helpers import two_cars
from helpers.small_weights import write_weights
from PIL import Image

import demo
from common import flags
from evaluation.side_by_side import SIDE_BY_SIDE
from experiments import demo as experiment
from kitti.objects import Objects
from models.weight_files import weights_sha256
from visualization.gallery import pictures

TINY = ("--sequences", "1", "--frames", "5", "--animation_frames", "3")


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    return write_weights(tmp_path_factory.mktemp("weights"))


def _run(out, weights, *more) -> int:
    return flags.run(demo.main, [*TINY, "--out", str(out), "--weights", str(weights), *more])


@pytest.mark.slow
def test_interrupted_then_finished_then_repeated(tmp_path, weights, monkeypatch, capsys):
    out = tmp_path / "demo"

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(experiment, "draw_tracks", interrupt)
        assert _run(out, weights) == flags.INTERRUPTED
    assert not (out / "metrics.json").exists()
    cached = {path: path.stat().st_mtime_ns for path in (out / experiment.CACHE).iterdir()}
    assert len(cached) == 2  # one sequence at 0 and at 2 m

    assert _run(out, weights) == 0  # resumes: the networks' outputs and the data are kept
    assert {path: path.stat().st_mtime_ns for path in cached} == cached
    printed = capsys.readouterr().out
    assert printed.startswith("device: ")
    metrics = json.loads((out / "metrics.json").read_text())
    assert list(metrics["figures"]) == ["0", "2"]
    for trackers in metrics["figures"].values():
        assert tuple(trackers) == SIDE_BY_SIDE
        gt = {record["clear3d"]["overall"]["GT"] for record in trackers.values()}
        assert len(gt) == 1
        assert all(r["seconds_per_frame"]["total"] > 0 for r in trackers.values())
    run = metrics["run"]
    assert {"python", "numpy", "tensorflow"} <= set(run["versions"])
    assert run["data"]["sequences"] == {"0016": 5} and run["data"]["simulated"]["seed"] == 0
    assert run["weights_sha256"] == weights_sha256(weights) and 0 < run["min_box_score"] < 1
    table = (out / "table.md").read_text()
    assert "| PointTrackNet, no probation |" in table and "paper, KITTI" in table
    assert table.splitlines()[4] in printed
    counts = metrics["boxes"]
    assert 0 <= counts["few_points"] < counts["labelled"] == next(iter(gt))
    assert f"{counts['few_points']} of the {counts['labelled']} labelled boxes" in table
    for name in ("table.md", "metrics.json", "index.html"):
        assert str(out / name) in printed
    sources = re.findall(r'(?:src|href)="([^"]*)"', (out / "index.html").read_text())
    inside = [source for source in sources if source.startswith("data:image/")]
    assert len(inside) == len(pictures(out))  # nothing but the pictures and a link to the scene
    assert [source for source in sources if source not in inside] == ["scene.html"]
    assert (out / "scene.html").stat().st_size > 4e6
    made = {picture.path: picture.path.stat().st_mtime_ns for picture in pictures(out)}
    assert all(str(path) in printed and path.stat().st_size > 1000 for path in made)
    with Image.open(out / "animation.gif") as animation:
        assert animation.n_frames == 3

    with monkeypatch.context() as patch:  # nothing is left to do for the networks
        patch.setattr("evaluation.detections.NetworkDetections.load", interrupt)
        patch.setattr(experiment, "draw_network", interrupt)
        patch.setattr(experiment, "evaluate_cached", interrupt)
        assert _run(out, weights) == 0
    assert {picture.path: picture.path.stat().st_mtime_ns for picture in pictures(out)} == made

    other = write_weights(tmp_path / "other", seed=1)
    assert _run(out, other) == 0  # other weights: everything that depends on them is new
    assert not set(cached) & set((out / experiment.CACHE).iterdir())
    assert all(path.stat().st_mtime_ns > made[path] for path in made)


@pytest.fixture
def recorded(tmp_path) -> experiment.Demo:
    """The demo of a recorded sequence, with files in place of the networks."""
    two_cars.write_sequence(tmp_path / "data", 0, frames=3)
    for name in ("detector.npz", "tracker.npz"):
        (tmp_path / name).write_bytes(b"")
    folders = {"out": tmp_path / "out", "weights": tmp_path, "data_root": tmp_path / "data"}
    return experiment.Demo(experiment.DemoConfig(**folders, seqs=(0,), iou=0.3))


def test_new_poses_are_evaluated(recorded, monkeypatch):
    evaluated = []
    monkeypatch.setattr(
        experiment, "evaluate_cached", lambda _, cached, tracker, out: evaluated.append(tracker)
    )
    recorded.evaluate(0.0)
    recorded.evaluate(0.0)
    assert evaluated == list(SIDE_BY_SIDE)
    poses = recorded.data_root / "poses" / "0000.txt"
    poses.parent.mkdir()
    poses.write_text((" ".join(map(str, np.eye(4)[:3].ravel())) + "\n") * 3)
    recorded.evaluate(0.0)
    assert evaluated == 2 * list(SIDE_BY_SIDE)


def test_the_scene_counts_errors_as_the_table_does(recorded, monkeypatch):
    drawn = []
    monkeypatch.setattr(experiment, "draw_scene", lambda *_, min_iou: drawn.append(min_iou))
    monkeypatch.setattr(recorded, "_tracks", lambda *_: Objects.empty())
    for name in ("pointtracknet", "sort"):
        folder = recorded.folder(2.0, name)
        folder.mkdir(parents=True)
        (folder / "record.json").write_text("{}")
    recorded.draw_drive()
    assert drawn == [0.3]


def test_outputs_that_others_have_cached_stay(recorded, monkeypatch):
    monkeypatch.setattr(recorded.cached, "fill_all", lambda *_: None)
    ours, others = (recorded.config.out / name for name in (experiment.CACHE, "network_cache"))
    for folder in (ours, others):
        folder.mkdir(parents=True)
        (folder / "0000-0123456789abcdef.npz").touch()
    recorded.fill_cache()
    assert len(list(others.iterdir())) == 1 and not list(ours.iterdir())


def test_missing_weights_end_with_one_line_and_code_2(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(experiment, "simulate", lambda argv: pytest.fail("too late"))
    assert _run(tmp_path / "out", tmp_path / "nothing") == 2
    assert not (tmp_path / "out").exists()
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "detector.npz: expected a checkpoint file" in error


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("--iou", "0"), "--iou: expected above 0 and at most 1, found 0"),
        (("--object_shifts", "0,2000"), "--object_shifts[1]: expected 0 to 1000.0, found 2000"),
    ],
)
def test_settings_are_checked_before_the_simulation(tmp_path, capsys, monkeypatch, argv, message):
    monkeypatch.setattr(experiment, "simulate", lambda argv: pytest.fail("too late"))
    for name in ("detector.npz", "tracker.npz"):
        (tmp_path / name).write_bytes(b"")
    assert _run(tmp_path / "out", tmp_path, *argv) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (("--displacements", "2,0"), "expected 0 and then others"),
        (("--data_root", "x"), "--data_root and --seqs go together"),
        (("--data_root", "x", "--seqs", "0000"), "--sequences and --frames are for simulated data"),
    ],
)
def test_flags_that_do_not_fit(tmp_path, capsys, argv, message):
    assert _run(tmp_path / "out", tmp_path, *argv) == 2
    assert message in capsys.readouterr().err


def test_a_failing_step_fails_the_demo(tmp_path, weights, monkeypatch):
    def fail(argv):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(experiment, "simulate", fail)
    assert _run(tmp_path / "out", weights) == 2
