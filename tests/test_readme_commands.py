"""Every command of README.md is run: here on small data, or by the test that `RUNS` names."""

from __future__ import annotations

import functools
import importlib
import json
import os
import re
import shlex
import socket
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from network_cases import SMALL_DETECTOR, SMALL_TRACKER
from small_inputs import config_flags, two_cars
from small_weights import write_weights

from common import flags
from common.provenance import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
PYTHON = ".venv/bin/python"
ON_KITTI, TRAINING = ("KITTI", "Tables, figures, pictures"), ("Training",)


class Here(NamedTuple):
    """Run by this file, with `more` added to the command, and with `SHORTER` words."""

    more: tuple[str, ...] = ()


SHORTER = {"0000-0015": "0000"}
ONE_STEP = ("--smoke", "--schedule.batch_size", "1", "--val_seqs", "0016")
TWO_STEPS = ("--smoke", "--schedule.batch_size", "2", "--val_seqs", "0016", "--seqs", "0000")
DETECTOR = tuple(config_flags(SMALL_DETECTOR, "detector"))
TRACKER = tuple(config_flags(SMALL_TRACKER, "tracker"))
NAMED = {"--tracker.fusion", "--tracker.fused_features"}  # in the commands themselves
ROW = tuple(
    word
    for pair in zip(TRACKER[::2], TRACKER[1::2], strict=True)
    if pair[0] not in NAMED
    for word in pair
)
TRACKING = "tests/experiments/test_tracking_experiments.py"
ABLATION = "tests/experiments/test_ablation.py"

RUNS: dict[str, Here | str] = {  # a part that one command of the README has and no other
    "make demo": "tests/test_demo.py::test_interrupted_then_finished_then_repeated",
    "make test": "tests/test_readme_commands.py::test_make_runs_the_demo_and_the_tests",
    "--scans DIR": "tests/test_track.py::test_command_line_writes_results_and_pictures",
    "--protocol clear3d": Here(),
    "--tracker sort": Here(),
    "--displacement 2 ": Here(),
    "--subset testing": "tests/evaluation/test_submission.py::test_all_29_sequences_are_in_the_zip",
    "demo.py": Here(),
    "--split train": Here(("--sequences", "1", "--frames", "4", "--processes", "1")),
    "--split val": Here(("--sequences", "1", "--frames", "2", "--processes", "1")),
    "--from_labels": Here(("--seqs", "0001", "--processes", "1")),
    "--workdir runs/detector": Here((*ONE_STEP, *DETECTOR)),
    "--workdir runs/tracker": Here((*ONE_STEP, *TRACKER)),
    "training.export": Here(),
    "--tracker.fusion ": Here((*ONE_STEP, "--seqs", "0000", *ROW)),
    "--tracker.fused_features": Here((*ONE_STEP, "--seqs", "0000", *ROW)),
    '"index": 0': Here((*TWO_STEPS, *DETECTOR)),
    '"index": 1': Here((*TWO_STEPS, *DETECTOR)),
    "experiments.table2": "tests/experiments/test_table2.py::test_table_2_of_small_networks",
    "experiments.table3": f"{ABLATION}::test_table3_goes_on_where_it_was_interrupted",
    "experiments.table4": f"{ABLATION}::test_table4_trains_a_row",
    "experiments.network_exam": Here(),
    "experiments.table5": f"{TRACKING}::test_table5_has_a_row_of_ours_above_each_of_the_papers",
    "experiments.figure5": f"{TRACKING}::test_figure5_writes_curve_and_picture",
    "visualize.py birds_eye": Here(),
    "visualize.py trajectories": Here(),
    "visualize.py animation": Here(),
    "visualize.py network": Here(),
    "experiments.readme_tables": Here(),
    "from pointtracknet import": "tests/test_readme.py::test_the_library_example_runs",
}


def _commands() -> list[tuple[str, str]]:
    """(section, command) of each line in a sh block, and of the Python block as a whole."""
    found, section = [], ""
    blocks = r"^## ([^\n]+)$|^```sh\n(.*?)^```|^```python\n(.*?)^```"
    for match in re.finditer(blocks, README, re.DOTALL | re.MULTILINE):
        section = match[1] or section
        lines = [match[3]] if match[3] else (match[2] or "").splitlines()
        found += [(section, line) for line in lines if line.strip()]
    return found


def _run_of(command: str) -> Here | str:
    (run,) = (run for part, run in RUNS.items() if part in command)
    return run


def _argv(command: str) -> tuple[str, list[str]]:
    """(module, arguments) of a README command in its small form."""
    run, words = _run_of(command), shlex.split(command.removesuffix("&"))
    words = [SHORTER.get(word, word) for word in words[words.index(PYTHON) + 1 :]]
    words, name = (words[2:], words[1]) if words[0] == "-m" else (words[1:], words[0])
    name = {"simulator": "simulator.__main__"}.get(name, name.removesuffix(".py"))
    return name, [*words, *run.more]


def _run_section(sections: tuple[str, ...], monkeypatch) -> list[str]:
    """Runs what `RUNS` marks with `Here`, in the README's order; returns the commands."""
    done = []
    for section, command in _commands():
        if section not in sections or isinstance(_run_of(command), str) or "TF_CONFIG" in command:
            continue
        name, argv = _argv(command)
        monkeypatch.setattr(sys, "argv", [name, *argv])
        assert flags.run(importlib.import_module(name).main, argv) == 0, command
        done.append(command)
    return done


def test_readme_and_table_have_the_same_commands():
    commands = [command for _, command in _commands()]
    assert len(commands) == len(RUNS)
    for part in RUNS:
        assert sum(part in command for command in commands) == 1, part
    sections = {section for section, c in _commands() if isinstance(_run_of(c), Here)}
    assert sections <= {*ON_KITTI, *TRAINING}  # those which the tests below go through


@pytest.mark.parametrize("name", sorted({run for run in RUNS.values() if isinstance(run, str)}))
def test_named_tests_exist(name):
    path, function = name.split("::")
    assert f"\ndef {function}(" in (ROOT / path).read_text(encoding="utf-8")


def test_make_runs_the_demo_and_the_tests():
    def recipe(*words):
        command = ["make", "-n", "--no-print-directory", "-C", str(ROOT), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
        return done.stdout.splitlines()[-1].split()

    assert recipe("demo") == [PYTHON, "demo.py"]
    assert recipe("test")[:3] == [PYTHON, "-m", "pytest"]
    (shorter,) = re.findall(r'`make (DEMO_FLAGS="[^"]+" demo)`', README)
    assert recipe(*shlex.split(shorter)) == [PYTHON, "demo.py", "--frames", "20"]


def _trace_once(monkeypatch):
    """These commands use the same weights: their graphs are made once, which takes most time."""
    from models.inference import StreamingNetwork
    from training.weights import load_networks

    load, build = functools.cache(load_networks), functools.cache(StreamingNetwork)
    for module in ("evaluation.network", "training.weights"):
        monkeypatch.setattr(f"{module}.load_networks", load)
    for module in ("evaluation.network", "models.inference"):
        monkeypatch.setattr(f"{module}.StreamingNetwork", build)


@pytest.mark.slow
def test_commands_on_kitti(tmp_path, monkeypatch, capsys):
    for seq in (0, *range(16, 21)):
        two_cars().write_sequence(tmp_path / "KITTI", seq, frames=3)
    write_weights(tmp_path / "weights")
    monkeypatch.chdir(tmp_path)
    _trace_once(monkeypatch)
    done = _run_section(ON_KITTI, monkeypatch)
    outputs = [re.search(r"--out (\S+)", command) for command in done]
    assert len(done) == 10
    assert all(Path(match[1]).exists() for match in outputs if match)
    assert Path("results/real/index.html").is_file()


@pytest.mark.slow
def test_training_commands(tmp_path, monkeypatch, capsys):
    two_cars().write_sequence(tmp_path / "KITTI", 1, frames=2)
    write_weights(tmp_path / "weights")
    monkeypatch.chdir(tmp_path)
    assert len(_run_section(TRAINING, monkeypatch)) == 8
    assert Path("data/replay/training/label_02/0001.txt").is_file()
    for name in ("detector.npz", "tracker.npz", "training.md"):
        assert Path("runs/weights", name).is_file()
    for name, field, value in (
        ("concat", "fusion", "concat"),
        ("fc2", "fused_features", "filter+FC2"),
    ):
        config = json.loads(Path("runs", name, "config.json").read_text())["config"]
        assert config["tracker"][field] == value


@pytest.mark.slow
def test_two_workers_on_one_machine(tmp_path):
    for seq in (0, 16):
        two_cars().write_sequence(tmp_path / "data" / ("val" if seq else "sim"), seq, frames=3)
    with socket.socket() as one, socket.socket() as two:
        for s in (one, two):
            s.bind(("127.0.0.1", 0))
        ports = [str(s.getsockname()[1]) for s in (one, two)]
    workers = []
    for _, command in _commands():
        if "TF_CONFIG" in command:
            setting = shlex.split(command)[0].removeprefix("TF_CONFIG=")
            for port, free in zip(("4001", "4002"), ports, strict=True):
                setting = setting.replace(port, free)
            name, argv = _argv(command)
            workers.append(
                subprocess.Popen(
                    [sys.executable, str(ROOT / f"{name}.py"), *argv],
                    cwd=tmp_path,
                    env={**os.environ, "TF_CONFIG": setting},
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                )
            )
    outputs = [worker.communicate(timeout=280)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], outputs
    assert (tmp_path / "runs" / "both" / "checkpoints" / "best.npz").is_file()
