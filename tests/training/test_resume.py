"""Trainings that go on after a kill: the first steps, another detector, the last validation."""

import dataclasses

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
