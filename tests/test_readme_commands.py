"""Every command of the documents is run: here on small data, or by the test that `RUNS` names."""

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
from helpers import two_cars
from helpers.config_flags import config_flags
from helpers.documents import PYTHON, Command, commands
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER
from helpers.small_weights import write_weights

from common import flags
from common.provenance import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
KITTI, TRAINING = "kitti", "training"


class Here(NamedTuple):
    """Run by the test of a group, with `more` added to the command, and with `SHORTER` words."""

    group: str
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
NETWORKS = "tests/experiments/test_network_tables.py"
ABLATION = "tests/experiments/test_ablation.py"
CALIBRATION = "tests/training/test_calibrate.py"
DECODING = "tests/studies/test_decoding_parameters.py"
MAKE = "tests/test_readme_commands.py::test_make_runs_the_documented_commands"

RUNS: dict[str, Here | str] = {  # a part that one command has and no other; of make, all of it
    "make": MAKE,
    "make demo": "tests/test_demo.py::test_interrupted_then_finished_then_repeated",
    "make test": MAKE,
    "make test-fast": MAKE,
    "make format": MAKE,
    "make lint": MAKE,
    "make ops": MAKE,
    "make ops NATIVE=1": MAKE,
    "make bench": MAKE,
    "make sanitize": MAKE,
    "make fuzz": MAKE,
    "make kill": MAKE,
    "make weights": MAKE,
    "pip install": "tests/test_install.py::test_the_library_runs_in_another_folder",
    "--scans DIR": "tests/test_track.py::test_command_line_writes_results_and_pictures",
    "--protocol clear3d": Here(KITTI),
    "--tracker sort": Here(KITTI),
    "--object_shift 2 ": Here(KITTI),
    "--subset testing": "tests/evaluation/test_submission.py::test_all_29_sequences_are_in_the_zip",
    "demo.py": Here(KITTI),
    "--tracker ab3dmot": Here(KITTI),
    "--results results/ab3dmot/tracks": Here(KITTI),
    "--out data/sim ": Here(TRAINING, ("--sequences", "1", "--frames", "4", "--processes", "1")),
    "--out data/val ": Here(TRAINING, ("--sequences", "1", "--frames", "2", "--processes", "1")),
    "--out data/replay ": Here(TRAINING, ("--seqs", "0001", "--processes", "1")),
    "--out data/own ": Here(TRAINING, ("--sequences", "1", "--frames", "1", "--processes", "1")),
    "--out data/replayed ": Here(TRAINING, ("--seqs", "0001", "--processes", "1")),
    "--out results/traffic ": Here(TRAINING, ("--frames", "2", "--processes", "1")),
    "visualize.py birds_eye --data_root results/traffic": Here(TRAINING),
    "studies.simulator_fidelity": (
        "tests/simulator/test_simulator_real.py::test_fidelity_meets_its_goals"
    ),
    "--workdir runs/detector": Here(TRAINING, (*ONE_STEP, *DETECTOR)),
    "--workdir runs/tracker": Here(TRAINING, (*ONE_STEP, *TRACKER)),
    "training.export": Here(TRAINING),
    "training.calibrate": f"{CALIBRATION}::test_a_scorer_is_fitted_stored_and_used",
    "--tracker.fusion ": Here(TRAINING, (*ONE_STEP, "--seqs", "0000", *ROW)),
    "--tracker.fused_features": Here(TRAINING, (*ONE_STEP, "--seqs", "0000", *ROW)),
    '"index": 0': Here(TRAINING, (*TWO_STEPS, *DETECTOR)),
    '"index": 1': Here(TRAINING, (*TWO_STEPS, *DETECTOR)),
    "experiments.table2": "tests/experiments/test_table2.py::test_table_2_of_small_networks",
    "experiments.profile": "tests/experiments/test_profile.py::test_profile_of_small_networks",
    "experiments.table3": f"{ABLATION}::test_tables_share_a_row_and_resume",
    "experiments.table4": f"{ABLATION}::test_tables_share_a_row_and_resume",
    "experiments.evaluate_networks --data_root KITTI": Here(KITTI),
    "experiments.evaluate_networks --data_root data/exam2": f"{NETWORKS}::test_networks_run_once",
    "experiments.table5 --data_root KITTI": (
        f"{TRACKING}::test_table5_has_parts_for_both_classes_beside_the_papers_rows"
    ),
    "experiments.table5 --data_root data/exam": f"{NETWORKS}::test_networks_run_once",
    "studies.displacement_readings": (
        f"{TRACKING}::test_readings_mark_the_default_and_choose_on_training_sequences"
    ),
    "studies.deep_sort_noise": (
        f"{TRACKING}::test_deep_sort_noise_default_is_a_scale_of_the_study"
    ),
    "experiments.figure5": f"{NETWORKS}::test_networks_run_once",
    "experiments.table6": f"{NETWORKS}::test_networks_run_once",
    "experiments.ab3dmot": f"{TRACKING}::test_ab3dmot_table_stands_beside_the_published_rows",
    "--protocol kitti3d,clear3d": Here(KITTI),
    "studies.track_errors": "tests/studies/test_track_errors.py::test_errors_of_result_files",
    "studies.decoding_parameters": f"{DECODING}::test_from_end_to_end",
    "visualize.py scene": Here(KITTI),
    "visualize.py birds_eye --data_root KITTI": Here(KITTI),
    "visualize.py trajectories": Here(KITTI),
    "visualize.py animation": Here(KITTI),
    "visualize.py network": Here(KITTI),
    "experiments.readme_tables": Here(KITTI),
}


def _matches(part: str, command: str) -> bool:
    return command == part if command.startswith("make") else part in command


def _run_of(command: str) -> Here | str:
    (run,) = (run for part, run in RUNS.items() if _matches(part, command))
    return run


def _argv(command: str) -> tuple[str, list[str]]:
    """(module, arguments) of a command in its small form."""
    run, words = _run_of(command), shlex.split(command.removesuffix("&"))
    words = [SHORTER.get(word, word) for word in words[words.index(PYTHON) + 1 :]]
    words, name = (words[2:], words[1]) if words[0] == "-m" else (words[1:], words[0])
    name = {"simulator": "simulator.__main__"}.get(name, name.removesuffix(".py"))
    return name, [*words, *run.more]


def _commands_of(group: str) -> list[Command]:
    """Those that run in this process, in the documents' order."""
    return [
        command
        for command in commands()
        if getattr(_run_of(command.text), "group", None) == group
        and "TF_CONFIG" not in command.text
    ]


def _run_group(group: str, monkeypatch) -> None:
    for command in _commands_of(group):
        name, argv = _argv(command.text)
        monkeypatch.setattr(sys, "argv", [name, *argv])
        assert flags.run(importlib.import_module(name).main, argv) == 0, command


def test_documents_and_table_have_the_same_commands():
    found = [command.text for command in commands()]
    for command in found:
        assert sum(_matches(part, command) for part in RUNS) == 1, command
    for part in RUNS:
        assert sum(_matches(part, command) for command in found) == 1, part


@pytest.mark.parametrize("name", sorted({run for run in RUNS.values() if isinstance(run, str)}))
def test_named_tests_exist(name):
    path, function = name.split("::")
    assert f"\ndef {function}(" in (ROOT / path).read_text(encoding="utf-8")


def _recipe(*words: str) -> list[str]:
    """The last command that make would run."""
    command = ["make", "-n", "--no-print-directory", "-C", str(ROOT), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return shlex.split(done.stdout.splitlines()[-1])


def test_make_runs_the_documented_commands():
    assert _recipe("demo") == [PYTHON, "demo.py"]
    assert _recipe("test")[:3] == [PYTHON, "-m", "pytest"]
    assert _recipe("test-fast")[-2:] == ["-m", "not slow"]
    assert _recipe("lint")[1] == "--dry-run" and _recipe("format")[1] == "-i"
    assert _recipe("weights")[1:] == ["-m", "training.recipe"]
    folders = _recipe("weights", "LABELS=/my kitti", "SCANS=/my scans")[3:]
    assert folders == ["--labels", "/my kitti", "--scans", "/my scans"]
    assert _recipe("bench")[1:] == ["-m", "tf_ops.bench", "readme"]
    assert _recipe("fuzz")[-6:-4] == ["-m", "campaigns.fuzz"]
    assert _recipe("kill")[-6:-4] == ["-m", "campaigns.kill"]
    assert _recipe("ops") == _recipe() != _recipe("sanitize")
    assert _recipe("ops") != _recipe("ops", "NATIVE=1")
    (shorter,) = re.findall(r'`make (DEMO_FLAGS="[^"]+" demo)`', README)
    assert _recipe(*shlex.split(shorter)) == [PYTHON, "demo.py", "--frames", "20"]


def _trace_once(monkeypatch):
    """These commands use the same weights: their graphs are made once, which takes most time."""
    from models.inference import StreamingNetwork
    from models.weights import load_networks

    load, build = functools.cache(load_networks), functools.cache(StreamingNetwork)
    monkeypatch.setattr("models.weights.load_networks", load)
    monkeypatch.setattr("models.inference.StreamingNetwork", build)


@pytest.mark.slow
def test_commands_on_kitti(tmp_path, monkeypatch, capsys):
    for seq in (0, *range(16, 21)):
        two_cars.write_sequence(tmp_path / "KITTI", seq, frames=3)
    write_weights(tmp_path / "weights")
    monkeypatch.chdir(tmp_path)
    _trace_once(monkeypatch)
    _run_group(KITTI, monkeypatch)
    outputs = [re.search(r"--out (\S+)", command.text) for command in _commands_of(KITTI)]
    assert all(Path(match[1]).exists() for match in outputs if match)
    assert Path("results/real/index.html").is_file()


@pytest.mark.slow
def test_training_commands(tmp_path, monkeypatch, capsys):
    two_cars.write_sequence(tmp_path / "KITTI", 1, frames=2)
    write_weights(tmp_path / "weights")
    monkeypatch.chdir(tmp_path)
    _run_group(TRAINING, monkeypatch)
    for name in ("replay", "replayed"):
        assert Path("data", name, "training/label_02/0001.txt").is_file()
    assert Path("docs/simulator/own_traffic.png").is_file()
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
        two_cars.write_sequence(tmp_path / "data" / ("val" if seq else "sim"), seq, frames=3)
    with socket.socket() as one, socket.socket() as two:
        for s in (one, two):
            s.bind(("127.0.0.1", 0))
        ports = [str(s.getsockname()[1]) for s in (one, two)]
    workers = []
    for command in commands():
        if "TF_CONFIG" in command.text:
            setting = shlex.split(command.text)[0].removeprefix("TF_CONFIG=")
            for port, free in zip(("4001", "4002"), ports, strict=True):
                setting = setting.replace(port, free)
            name, argv = _argv(command.text)
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
