"""training.export: the last checkpoint of a training, or the mean of its last epochs."""

import json

import numpy as np
import pytest
from helpers.small_weights import write_weights

from common import flags
from models import checkpoint
from models.boxes.box_score import BoxScorer, save_scorer
from models.detector import Detector
from models.weights import load_detector
from training import export


def train(workdir, source, epochs: dict[int, float | None]) -> None:
    """Checkpoints of a training: step -> a factor on the weights; None within an epoch."""
    meta, arrays = checkpoint.load(source)
    meta.pop("format")
    network = load_detector(source)
    weights = checkpoint.named_variables(network)
    meta["record"] = {"command": "train", "time_utc": "", "git_commit": "", "parameters": 1}
    meta["record"]["data"] = {"training": ["a/0001"], "validation": []}
    for step, factor in epochs.items():
        scaled = {name: array * (factor or 100.0) for name, array in arrays.items()}
        checkpoint.restore(source, scaled, model=weights)
        meta |= {"step": step, "metrics": {} if factor is None else {"loss": factor}}
        checkpoint.save(workdir / f"checkpoints/step-{step:08d}.npz", meta, model=weights)


@pytest.fixture
def source(tmp_path):
    return write_weights(tmp_path / "small") / "detector.npz"


def run(*argv) -> int:
    return flags.run(export.main, [str(value) for value in argv])


def factors(path, source) -> set[float]:
    """By which the weights of `source` were multiplied."""
    old, new = (checkpoint.load(p)[1] for p in (source, path))
    found = (new[name][a != 0] / a[a != 0] for name, a in old.items() if a.any())
    return {float(np.round(ratio.mean(), 4)) for ratio in found}


def test_the_mean_of_the_last_epochs(tmp_path, source):
    train(tmp_path / "run", source, {10: 1.0, 15: None, 20: 2.0, 30: 6.0})
    out = ("--detector", tmp_path / "run", "--out", tmp_path / "out")
    assert run(*out) == 0
    assert factors(tmp_path / "out/detector.npz", source) == {6.0}
    assert run(*out, "--mean_of_epochs", 3) == 0
    assert factors(tmp_path / "out/detector.npz", source) == {3.0}
    assert isinstance(load_detector(tmp_path / "out/detector.npz"), Detector)
    meta = json.loads((tmp_path / "out/detector.json").read_text())
    assert (meta["mean_of_steps"], meta["metrics"]) == ([10, 20, 30], {})
    assert "| mean of the weights after steps | 10, 20, 30 |" in (
        (tmp_path / "out/training.md").read_text()
    )


def test_a_training_stopped_within_an_epoch_ends_there(tmp_path, source):
    train(tmp_path / "run", source, {10: 1.0, 20: 2.0, 25: None})
    given = ("--detector", tmp_path / "run", "--out", tmp_path / "out", "--mean_of_epochs", 2)
    assert run(*given) == 0
    assert factors(tmp_path / "out/detector.npz", source) == {51.0}


def test_too_few_epochs_and_other_networks_are_named(tmp_path, source, capsys):
    train(tmp_path / "run", source, {10: 1.0, 15: None, 20: 2.0})
    given = ("--detector", tmp_path / "run", "--out", tmp_path / "out", "--mean_of_epochs")
    assert run(*given, 3) == 2
    assert "at least 3 epochs (--schedule.keep_checkpoints), found 2" in capsys.readouterr().err
    path = tmp_path / "run/checkpoints/step-00000010.npz"
    meta = checkpoint.load(path)[0]
    np.savez(path, meta=np.frombuffer(json.dumps(meta).encode(), np.uint8), **{"model/x": [1.0]})
    assert run(*given, 2) == 2
    assert "step-00000010.npz: arrays do not fit" in capsys.readouterr().err
    one = ("--detector", source, "--out", tmp_path / "out", "--mean_of_epochs", 2)
    assert run(*one) == 2
    assert "--mean_of_epochs: expected a training's workdir" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"record": None},
        {"record": []},
        {"record": {"command": "train"}},
        {"metrics": None},
        {"step": None},
        {"config": {}},
        {"metrics": {"loss": float("nan")}},
    ],
    ids=str,
)
def test_a_checkpoint_of_no_training_is_refused_before_anything_is_written(
    tmp_path, source, capsys, change
):
    train(tmp_path / "run", source, {10: 1.0})
    path = tmp_path / "run/checkpoints/step-00000010.npz"
    meta, arrays = checkpoint.load(path)
    text = json.dumps({**meta, **change}).encode()
    np.savez(path, meta=np.frombuffer(text, np.uint8), **arrays)
    assert run("--detector", tmp_path / "run", "--out", tmp_path / "out") == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1 and "step-00000010.npz: not a training's checkpoint" in error[0]
    assert not (tmp_path / "out").exists()


def test_a_resumed_training_says_so(tmp_path, source):
    train(tmp_path / "run", source, {10: 1.0})
    meta = checkpoint.load(tmp_path / "run/checkpoints/step-00000010.npz")[0]
    meta["record"]["resumed"] = [{"step": 5, "git_commit": "abc"}]
    meta["record"]["data"]["init"] = "a.npz"
    text = export.describe(meta, source)
    assert "| resumed | at step 5, commit abc |" in text
    assert "| started from | a.npz |" in text


def test_a_folder_with_the_tracker_of_another_detector_is_refused(tmp_path, source, capsys):
    """Not with a tracker that fits: the recipe exports its detector again."""
    train(tmp_path / "run", source, {10: 1.0, 20: 2.0})
    tracker = source.with_name("tracker.npz")
    out = tmp_path / "out"
    first = ("--detector", tmp_path / "run/checkpoints/step-00000010.npz", "--out", out)
    for _ in range(2):
        assert run(*first) == 0
    (out / "tracker.npz").write_bytes(tracker.read_bytes())
    scorer = BoxScorer("another", 0.4, 0.5, ("votes",), (2.0,), (1.0,), (1.5,))
    save_scorer(out, scorer)
    assert run(*first) == 0
    assert "scorer was fitted for another detector: training.calibrate" in capsys.readouterr().err
    assert run("--detector", tmp_path / "run", "--out", out) == 2
    error = capsys.readouterr().err
    assert "tracker.npz: this tracker was trained on another detector: give --tracker too" in error
    assert factors(out / "detector.npz", source) == {1.0}


def test_the_history_is_that_of_the_network(tmp_path, source, capsys):
    """Of the workdir, or beside an exported network; nothing else in the folders above."""
    train(tmp_path / "run", source, {10: 1.0})
    (tmp_path / "run/history.csv").write_text("its own")
    (tmp_path / "history.csv").write_text("another's")
    assert run("--detector", tmp_path / "run", "--out", tmp_path / "a") == 0
    assert (tmp_path / "a/detector_history.csv").read_text() == "its own"
    for out in ("b", "b", "a"):
        assert run("--detector", tmp_path / "a/detector.npz", "--out", tmp_path / out) == 0
        assert (tmp_path / out / "detector_history.csv").read_text() == "its own"
    assert "before" not in capsys.readouterr().err
    (tmp_path / "run/history.csv").unlink()
    assert run("--detector", tmp_path / "run", "--out", tmp_path / "a") == 0
    assert "detector_history.csv: is of the network that was here before" in capsys.readouterr().err
