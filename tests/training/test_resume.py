"""Trainings that go on after a kill: the first steps, another detector, the last validation."""

import dataclasses
import json

import numpy as np
import pytest
from helpers.config_flags import config_flags
from helpers.detector_run import SHORT, detector_run
from helpers.network_cases import SMALL_DETECTOR

import train_det
from common.config import parse_json
from common.errors import InputError
from common.files import write_json
from models import checkpoint
from training import loop
from training.checkpoint_folder import CheckpointFolder
from training.run_state import resume_run, save_checkpoint


def test_resumed_before_the_first_checkpoint_starts_from_init(tiny_data, tmp_path, monkeypatch):
    """--init with --resume, of a training that was killed before it wrote a checkpoint."""
    trained = detector_run(tiny_data, tmp_path / "trained", SHORT)
    path, workdir = tmp_path / "trained.npz", tmp_path / "workdir"
    checkpoint.save(path, {"kind": "detector", "config": {}}, **trained.networks)
    words = ["--data_root", tiny_data, "--seqs", "0000", "--val_data_root", tiny_data]
    words += ["--val_seqs", "0001", "--workdir", workdir, "--init", path, "--smoke"]
    words = [str(word) for word in (*words, *config_flags(SMALL_DETECTOR, "detector"))]
    seen = []

    def killed(run, resume):
        variables = checkpoint.named_variables(run.task.model)
        seen.append({name: variable.numpy() for name, variable in variables.items()})
        if not resume:
            write_json(workdir / "config.json", {})

    monkeypatch.setattr(loop, "run_training", killed)
    train_det.main(words)
    train_det.main([*words, "--resume"])
    for name, variable in checkpoint.named_variables(trained.task.model).items():
        for found in seen:
            np.testing.assert_array_equal(found[name], variable, err_msg=name)
    (workdir / "checkpoints" / "step-00000001.npz").parent.mkdir()
    (workdir / "checkpoints" / "step-00000001.npz").touch()
    train_det.main([*words, "--resume"])  # now the checkpoint decides
    assert any(np.any(seen[2][name] != seen[0][name]) for name in seen[0])


def test_flags_may_change_before_the_first_checkpoint_and_are_recorded(tiny_data, tmp_path):
    write_json(tmp_path / "config.json", {"config": "of a training without a checkpoint"})
    run = detector_run(tiny_data, tmp_path, SHORT)
    loop.run_training(run, resume=True)
    assert parse_json((tmp_path / "config.json").read_bytes(), tmp_path) == run.started


def test_an_interrupt_says_where_it_goes_on(tiny_data, tmp_path, monkeypatch, capsys):
    def interrupted(run, resume):
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "run_training", interrupted)
    words = ["--data_root", tiny_data, "--seqs", "0000", "--val_data_root", tiny_data, "--smoke"]
    words += ["--val_seqs", "0001", "--workdir", tmp_path / "workdir"]
    words = [str(word) for word in (*words, *config_flags(SMALL_DETECTOR, "detector"))]
    with pytest.raises(KeyboardInterrupt):
        train_det.main(words)
    assert "--resume goes on from step 0" in capsys.readouterr().err


def test_a_tracker_does_not_resume_on_another_detector(tiny_data, tmp_path):
    run = detector_run(tiny_data, tmp_path, SHORT)
    loop.run_training(run)
    again = detector_run(tiny_data, tmp_path, SHORT)
    again.task.meta = {**again.task.meta, "detector_sha256": "another"}
    with pytest.raises(InputError, match=r"another detector_sha256: None -> another"):
        loop.run_training(again, resume=True)


def test_a_kill_in_the_last_validation_repeats_it(tiny_data, tmp_path, monkeypatch):
    schedule = dataclasses.replace(SHORT, checkpoint_minutes=0.0)
    with monkeypatch.context() as patch:
        patch.setattr(loop, "validate", lambda _: pytest.exit("killed"))
        with pytest.raises(pytest.exit.Exception):
            loop.run_training(detector_run(tiny_data, tmp_path, schedule))
    found = loop.run_training(detector_run(tiny_data, tmp_path, schedule), resume=True)
    assert "box_f1_0.5" in found
    assert (tmp_path / "checkpoints" / "best.npz").exists()
    assert len((tmp_path / "history.csv").read_text().splitlines()) == 2


def saved(data, workdir, step: int = 1) -> tuple[CheckpointFolder, dict]:
    """A workdir with one checkpoint of a training that was started with --init; its record."""
    run, folder = detector_run(data, workdir, SHORT), CheckpointFolder(workdir / "checkpoints")
    run.started["data"] |= {"init": "a.npz", "validation": ["data/0001"]}
    run.started |= {"command": "train_det.py --init a.npz", "git_commit": "abc"}
    save_checkpoint(run, folder, step, {"loss": 1.0})
    return folder, run.started


def resumed(data, workdir, validation: str = "data/0001"):
    run = detector_run(data, workdir, SHORT)
    run.started["data"] |= {"init": None, "validation": [validation]}
    return run


def test_the_record_of_the_start_stays(tiny_data, tmp_path):
    """And names each command that resumed."""
    folder, first = saved(tiny_data, tmp_path)
    for step in (1, 2):
        run = resumed(tiny_data, tmp_path, "moved/0001")
        run.started["command"] = f"train_det.py --resume {step}"
        assert resume_run(run, folder) == step
        save_checkpoint(run, folder, step + 1, {"loss": 1.0})
    record = checkpoint.load(folder.path(3))[0]["record"]
    parts = record.pop("resumed")
    assert record == first
    assert [(part["step"], part["command"]) for part in parts] == [
        (1, "train_det.py --resume 1"),
        (2, "train_det.py --resume 2"),
    ]


def test_other_validation_sequences_are_refused(tiny_data, tmp_path):
    """best.npz would compare figures of different data."""
    folder, _ = saved(tiny_data, tmp_path)
    with pytest.raises(InputError, match="was made with other validation sequences"):
        resume_run(resumed(tiny_data, tmp_path, "data/0002"), folder)


@pytest.mark.parametrize(
    "change",
    [
        {"record": None},
        {"record": []},
        {"step": None},
        {"step": 7},
        {"record": {"data": 3}},
        {"record": {"data": {"shares": [{}]}}},
        {"record": {"data": {"training": 5}}},
        {"record": {"resumed": 3}},
    ],
    ids=str,
)
def test_a_checkpoint_of_no_training_is_not_resumed(tiny_data, tmp_path, change):
    folder, _ = saved(tiny_data, tmp_path)
    meta, arrays = checkpoint.load(folder.path(1))
    text = json.dumps({**meta, **change}).encode()
    np.savez(folder.path(1), meta=np.frombuffer(text, np.uint8), **arrays)
    with pytest.raises(InputError, match=r"step-00000001.npz: not a training's checkpoint"):
        resume_run(resumed(tiny_data, tmp_path), folder)
