"""Whole trainings: resumed after SIGKILL, on two workers, and diverging."""

import dataclasses
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from campaigns.kill import ENVIRONMENT
from helpers.detector_run import SHORT, detector_run

import train_det
import train_track
from common.errors import InputError
from common.flags import run as run_script
from common.provenance import ROOT
from models import checkpoint
from models.detector import Detector
from models.weights import load_detector, load_networks, load_tracker
from training import loop
from training.checkpoint_folder import CheckpointFolder
from training.command_line import check_memory, start_from
from training.config import (
    AugmentationConfig,
    DetectorTrainingConfig,
    TrackerTrainingConfig,
)
from training.logs import History


def start_process(*arguments, **environment) -> subprocess.Popen:
    command = [sys.executable, "-m", "helpers.train_small", *map(str, arguments)]
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, **ENVIRONMENT, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(*processes: subprocess.Popen) -> list[int]:
    outputs = [process.communicate(timeout=280)[0] for process in processes]
    codes = [process.returncode for process in processes]
    assert all(code in (0, -signal.SIGKILL) for code in codes), outputs
    return codes


def last_arrays(workdir: Path) -> dict[str, np.ndarray]:
    folder = CheckpointFolder(workdir / "checkpoints", 3)
    return checkpoint.load(folder.path(folder.steps()[-1]))[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["detector", "tracker"])
def test_killed_and_resumed_equals_uninterrupted(kind, tiny_data, tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    processes = [
        start_process(kind, tiny_data, whole),
        start_process(kind, tiny_data, cut, "--die_after", 4),
    ]
    assert finish(*processes) == [0, -signal.SIGKILL]
    assert finish(start_process(kind, tiny_data, cut, "--resume")) == [0]
    expected, found = last_arrays(whole), last_arrays(cut)
    assert expected.keys() == found.keys()
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    rows = [(folder / "history.csv").read_text().splitlines() for folder in (whole, cut)]
    assert len(rows[0]) == len(rows[1]) == 1 + 3


def free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return ports


@pytest.mark.slow
def test_two_workers_equal_one_with_the_joint_batch(tiny_data, tmp_path):
    workers = [f"127.0.0.1:{port}" for port in free_ports(2)]

    def tf_config(index):
        task = {"type": "worker", "index": index}
        return json.dumps({"cluster": {"worker": workers}, "task": task})

    folders = [tmp_path / "worker0", tmp_path / "worker1", tmp_path / "one"]
    finish(
        *[
            start_process(
                "detector",
                tiny_data,
                folders[i],
                "--strategy",
                "multiworker",
                "--epochs",
                1,
                TF_CONFIG=tf_config(i),
            )
            for i in range(2)
        ]
    )
    finish(start_process("detector", tiny_data, folders[2], "--epochs", 1))
    first, alone = last_arrays(folders[0]), last_arrays(folders[2])
    _, second = checkpoint.load(folders[1] / "weights.npz")
    for name, array in second.items():
        np.testing.assert_array_equal(array, first[name], err_msg=name)
    for name in second:  # two steps move a weight by up to 6.5e-4
        np.testing.assert_allclose(first[name], alone[name], rtol=1e-4, atol=5e-5, err_msg=name)
    moments = [name for name in alone if name.endswith(("/momentum", "/velocity"))]
    assert len(moments) > 20  # they are 0 at the start: sums of gradients and of their squares
    for name in moments:
        error = np.linalg.norm(first[name] - alone[name])
        assert error <= 1e-3 * np.linalg.norm(alone[name]), name
    rows = [History(folder / "history.csv", 10**6).rows[0] for folder in (folders[0], folders[2])]
    for name in ("loss", "gradient_norm"):
        assert rows[0][name] == pytest.approx(rows[1][name], rel=1e-3), name


def test_a_used_workdir_is_refused_without_resume(tiny_data, tmp_path):
    run = detector_run(tiny_data, tmp_path, SHORT)
    figures = loop.run_training(run)
    assert {"loss", "mask", "center", "mask_iou", "box_recall_0.5"} <= figures.keys()
    for name in ("config.json", "history.csv", "curves.png", "checkpoints/best.npz"):
        assert (tmp_path / name).stat().st_size > 0
    with pytest.raises(InputError, match="--resume"):
        loop.run_training(detector_run(tiny_data, tmp_path, SHORT))
    again = loop.run_training(detector_run(tiny_data, tmp_path, SHORT), resume=True)
    assert again == {name: pytest.approx(value, rel=1e-5) for name, value in figures.items()}
    other = dataclasses.replace(SHORT, seed=5)
    with pytest.raises(InputError, match=r"another configuration: schedule.seed 0 -> 5"):
        loop.run_training(detector_run(tiny_data, tmp_path, other), resume=True)
    with pytest.raises(InputError, match=r"made with other training sequences"):
        loop.run_training(detector_run(tiny_data, tmp_path, SHORT, ["data/0001"]), resume=True)
    moved = detector_run(tiny_data, tmp_path, SHORT, ["elsewhere/0000"])
    assert loop.run_training(moved, resume=True) == again


def test_a_loss_that_is_not_finite_stops_and_keeps_the_checkpoint(tiny_data, tmp_path):
    schedule = dataclasses.replace(SHORT, epochs=3, checkpoint_minutes=0.0)
    run = detector_run(tiny_data, tmp_path, schedule)
    losses, calls = run.task.losses, []

    def failing(batch, training):
        terms = losses(batch, training)
        step = tf.cast(run.optimizer.iterations.value, tf.float32)
        calls.append(1)
        bad = tf.where(step >= 3.0, np.nan, 1.0)
        return {name: value * bad for name, value in terms.items()}

    run.task.losses = failing
    with pytest.raises(loop.TrainingDivergedError, match="step 3"):
        loop.run_training(run)
    folder = CheckpointFolder(tmp_path / "checkpoints", 3)
    assert folder.steps()[-1] == 3
    arrays = checkpoint.load(folder.path(3))[1]
    assert all(np.isfinite(array).all() for array in arrays.values())


def test_scripts_train_and_their_weights_load(tiny_data, tmp_path, capsys):
    """--smoke of both scripts with the paper's networks; the two belong together afterwards."""
    common = [
        "--data_root",
        str(tiny_data),
        "--seqs",
        "0000",
        "--val_seqs",
        "0001",
        "--smoke",
        "--schedule.batch_size",
        "1",
    ]
    weights = tmp_path / "weights"
    weights.mkdir()
    assert run_script(train_det.main, [*common, "--workdir", str(tmp_path / "det")]) == 0
    (tmp_path / "det/checkpoints/best.npz").rename(weights / "detector.npz")
    detector = ["--detector", str(weights / "detector.npz")]
    work = ["--workdir", str(tmp_path / "track")]
    assert run_script(train_track.main, [*common, *detector, *work]) == 0
    (tmp_path / "track/checkpoints/best.npz").rename(weights / "tracker.npz")
    load_networks(weights)
    other = Detector(load_detector(weights / "detector.npz").config)
    with pytest.raises(InputError, match="another detector"):
        load_tracker(weights / "tracker.npz", other)
    with pytest.raises(InputError, match="expected a detector checkpoint, found 'tracker'"):
        load_detector(weights / "tracker.npz")
    capsys.readouterr()
    assert run_script(train_det.main, [*common, "--workdir", str(tmp_path / "det")]) == 2
    error = capsys.readouterr().err.strip()
    assert "--resume" in error.splitlines()[-1]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--schedule.epochs", "two"], "--schedule.epochs: expected an integer, found 'two'"),
        (["--no_such_flag"], "unrecognized arguments"),
        (["--strategy", "many"], "invalid choice"),
    ],
)
def test_bad_flags_exit_with_2(flags, message, capsys):
    with pytest.raises(SystemExit) as exit_:
        train_det.main(["--data_root", "x", "--workdir", "y", *flags])
    assert exit_.value.code == 2
    assert message in capsys.readouterr().err


def test_bad_configuration_and_data_are_named(tmp_path, capsys):
    base = ["--data_root", str(tmp_path / "none"), "--workdir", str(tmp_path / "work")]
    assert run_script(train_det.main, base) == 2
    assert "none" in capsys.readouterr().err
    bad = ["--detector.point_features", "colour"]
    assert run_script(train_det.main, [*base, *bad]) == 2
    assert "point_features: expected one of" in capsys.readouterr().err
    assert not (tmp_path / "work").exists()


ABSURD = f"1{'0' * 30}"
OUT_OF_RANGE = [
    *(("schedule.batch_size", value) for value in ("0", "-1", ABSURD)),
    *(("schedule.learning_rate_max", value) for value in ("nan", "-1e-3", "0", "inf", "2")),
    *(("schedule.learning_rate_min", value) for value in ("nan", "-1e-3", "0.5")),
    *(("schedule.epsilon", value) for value in ("0", "nan", "1e-300")),
    *(("schedule.clip_norm", value) for value in ("0", "-1", "1e30")),
    *(("schedule.beta2", value) for value in ("1", "-0.1", "nan")),
    *(("schedule.seed", value) for value in ("-1", str(2**40), ABSURD)),
    *(("schedule.epochs", value) for value in ("-1", ABSURD)),
    *(("schedule.keep_checkpoints", value) for value in ("0", "-2")),
    *(("schedule.frozen_batch_norm_from", value) for value in ("1.1", "-0.1", "nan")),
    *(("augmentation.object_shift_share", value) for value in ("1.5", "-0.1", "nan")),
    *(("augmentation.object_shift", value) for value in ("-1", "1e15")),
    *(("loss.mask", value) for value in ("-1", "nan", "1e15")),
    *(("focal_gamma", value) for value in ("-1", "1e15")),
    *(("query_points", value) for value in ("-1", ABSURD)),
    *(("detector.num_points", value) for value in ("0", "-5", "1000000", ABSURD)),
    *(("detector.batch_norm_momentum", value) for value in ("1", "nan")),
    *(("detector.box.classes", value) for value in ('["Boat"]', '["Car","car"]', '["DontCare"]')),
    ("detector.set_upconv", '[{"radius": 1, "widths": [8]}]'),
    ("detector.set_abstraction", '[{"num_points": 5, "radius": 0, "widths": [8]}]'),
    *(("workers", value) for value in ("-1", "257", ABSURD)),
    *(("share", value) for value in ("1.5", "nan", "0", "0.5")),
]


@pytest.mark.parametrize(("flag", "value"), OUT_OF_RANGE, ids=lambda word: word[:32])
def test_values_out_of_range_are_one_line(tiny_data, tmp_path, capsys, flag, value):
    base = ["--data_root", tiny_data, "--seqs", "0000", "--val_seqs", "0001"]
    words = [*base, "--workdir", tmp_path / "work", f"--{flag}", value]
    try:
        code = run_script(train_det.main, [str(word) for word in words])
    except SystemExit as end:
        code = end.code
    error = capsys.readouterr().err
    assert code == 2 and error.count("\n") == 1
    assert flag.rpartition(".")[2] in error
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"association_radius": 0}, "association_radius: expected 0.001 to 1000"),
        ({"set_abstraction": []}, "set_abstraction: expected 2 items"),
        ({"num_kept_points": 10**9}, "num_kept_points: expected 1 to 200000"),
    ],
)
def test_trackers_that_cannot_be_built_are_refused(tmp_path, capsys, changes, message):
    (flag, value), *_ = changes.items()
    base = ["--data_root", "x", "--workdir", str(tmp_path / "work"), "--detector", "x"]
    assert run_script(train_track.main, [*base, f"--tracker.{flag}", json.dumps(value)]) == 2
    assert message in capsys.readouterr().err


def test_a_batch_larger_than_the_memory_is_refused():
    check_memory(8, 15_000)
    with pytest.raises(InputError, match=r"4096 samples of 200000 points need at least 15\d\d GiB"):
        check_memory(4096, 200_000)


def test_weights_that_are_not_finite_end_the_training(tiny_data, tmp_path):
    run = detector_run(tiny_data, tmp_path, SHORT)
    for variable in run.task.model.trainable_weights:
        variable.assign(np.nan * variable)
    with pytest.raises(loop.TrainingDivergedError, match=r"epoch 1: .* values must be finite"):
        loop.run_training(run)


def test_frozen_batch_norm_leaves_the_averages_as_they_are(tiny_data, tmp_path):
    for frozen in (False, True):
        schedule = dataclasses.replace(SHORT, frozen_batch_norm_from=0.0 if frozen else 1.0)
        run = detector_run(tiny_data, tmp_path / str(frozen), schedule)
        model = run.task.model
        before = [[w.numpy() for w in group] for group in (model.weights, model.trainable_weights)]
        loop.run_training(run)
        after = [model.weights, model.trainable_weights]
        moved = [
            sum(np.any(old != new.numpy()) for old, new in zip(*pair, strict=True))
            for pair in zip(before, after, strict=True)
        ]
        averages = len(model.non_trainable_weights)
        assert moved[1] > 0
        assert moved[0] - moved[1] == (0 if frozen else averages)


def test_init_starts_from_the_network_of_a_checkpoint(tiny_data, tmp_path):
    trained, other = (detector_run(tiny_data, tmp_path, SHORT) for _ in range(2))
    path = tmp_path / "trained.npz"
    checkpoint.save(path, {"kind": "detector", "config": {}}, **trained.networks)
    start_from(path, other)
    for name, variable in checkpoint.named_variables(other.task.model).items():
        expected = checkpoint.named_variables(trained.task.model)[name]
        np.testing.assert_array_equal(variable, expected, err_msg=name)
    checkpoint.save(path, {"kind": "tracker", "config": {}}, **trained.networks)
    with pytest.raises(InputError, match="expected a detector checkpoint, found 'tracker'"):
        start_from(path, other)


def test_defaults_are_the_papers():
    schedule = DetectorTrainingConfig().schedule
    assert (schedule.batch_size, TrackerTrainingConfig().schedule.batch_size) == (8, 6)
    assert (schedule.learning_rate_min, schedule.learning_rate_max) == (1e-4, 1e-3)
    assert (schedule.cycle_epochs, schedule.beta1, schedule.beta2) == (8, 0.9, 0.999)
    assert schedule.epsilon == 1e-8
    assert AugmentationConfig().object_shift == 2.0


def test_validation_looks_at_every_point(tiny_data, tmp_path):
    """The query points of a training are chosen by the labels."""
    run = detector_run(tiny_data, tmp_path, SHORT, query_points=60)
    assert len(run.task.samples(0, 0).query) == 60
    sample = run.task.validation_samples(0, 0)
    np.testing.assert_array_equal(sample.query, sample.points)
