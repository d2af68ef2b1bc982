"""The recipe: its commands parse, stages are skipped when done, wrong workdirs are refused."""

import json
import shlex
from pathlib import Path

import pytest
from helpers.two_cars import write_sequence

from common.errors import InputError
from common.provenance import ROOT
from training import calibrate, recipe
from training.command_line import configured, parser
from training.config import DetectorTrainingConfig, TrackerTrainingConfig
from training.recipe import RECIPE, Stage, make_weights, stages_of
from training.sampling.data import HELD_OUT

RECIPE_VALUES = json.loads(RECIPE.read_text())
ALL = {
    "work": "w",
    "labels": "KITTI",
    "label_seqs": "0001-0015",
    "scans": "REAL",
    "scan_seqs": "0100",
    "scan_val_seqs": "0103",
}


def test_the_commands_of_other_programs_parse():
    from simulator.__main__ import parser as simulator_parser

    stages = [s for s in stages_of(RECIPE_VALUES, ALL) if s.command[:2] == ("-m", "simulator")]
    assert len(stages) == 3
    for stage in stages:
        simulator_parser().parse_args(stage.command[2:])


def test_paths_with_spaces_are_one_word_each():
    spaced = {**ALL, "work": "my work", "labels": "my kitti", "scans": "my scans"}
    words = [word for stage in stages_of(RECIPE_VALUES, spaced) for word in stage.command]
    plain = [word for stage in stages_of(RECIPE_VALUES, ALL) for word in stage.command]
    assert len(words) == len(plain)
    assert {"my kitti", "my scans", "my work/data/own"} <= set(words)


def command(stages: list[Stage], program: str) -> list[str]:
    return next(list(s.command[1:]) for s in stages if s.command[0] == program)


@pytest.mark.parametrize("values", [ALL, {"work": "w"}], ids=["all data", "simulation alone"])
def test_trainings_parse_and_have_the_budget(values):
    stages = stages_of(RECIPE_VALUES, values)
    flags = parser("", DetectorTrainingConfig()).parse_args(command(stages, "train_det.py"))
    schedule = configured(flags, DetectorTrainingConfig()).schedule
    assert schedule.epochs * schedule.frames_per_epoch >= 100_000
    tracker = parser("", TrackerTrainingConfig())
    tracker.add_argument("--detector")
    flags = tracker.parse_args(command(stages, "train_track.py"))
    schedule = configured(flags, TrackerTrainingConfig()).schedule
    assert schedule.epochs * schedule.frames_per_epoch >= 25_000
    roots = ["w/data/own", "w/data/replay", "REAL"] if values is ALL else ["w/data/own"]
    assert flags.data_root == roots
    text = " ".join(shlex.join(stage.command) for stage in stages)
    assert ("--from_labels KITTI" in text) == (values is ALL)


@pytest.mark.parametrize("values", [ALL, {"work": "w"}], ids=["all data", "simulation alone"])
def test_scores_are_calibrated_on_validation_drives(values):
    stages = stages_of(RECIPE_VALUES, values)
    (words,) = [s.command[2:] for s in stages if s.command[1] == "training.calibrate"]
    flags = calibrate.make_parser().parse_args(list(words))
    assert flags.simulated_root == ["w/data/validation"]
    assert (flags.real_root, flags.real_seqs) == (
        (["REAL"], ALL["scan_val_seqs"]) if values is ALL else ([], None)
    )


def touch(path: Path, code: int = 0) -> tuple[str, ...]:
    script = f"import pathlib, sys; p = pathlib.Path({str(path)!r}); p.parent.mkdir(exist_ok=True)"
    return (
        "-c",
        f"{script}; p.write_text('x' + (p.read_text() if p.exists() else '')); sys.exit({code})",
    )


def test_stages_run_once_and_a_failed_one_again(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(recipe, "git_commit", lambda: "abc")
    work, out = tmp_path / "work", tmp_path / "out"
    done, broken = work / "weights" / "done", work / "weights" / "broken"
    stages = [Stage("one", touch(done)), Stage("two", touch(broken, code=3))]
    for _ in range(2):
        with pytest.raises(InputError, match="two: the command ended with code 3"):
            make_weights(stages, work, out, allow_changes=False)
    assert done.read_text() == "x"
    assert broken.read_text() == "xx"
    assert not out.exists()
    assert "stage 1 of 2: one" in capfd.readouterr().out
    other = [Stage("one", ("-c", "pass"))]
    with pytest.raises(InputError, match="one: was begun with another command"):
        make_weights(other, work, out, allow_changes=False)
    monkeypatch.setattr(recipe, "git_commit", lambda: "def")
    with pytest.raises(InputError, match="two: was begun at commit abc"):
        make_weights(stages, work, out, allow_changes=False)
    assert broken.read_text() == "xx"
    make_weights(stages[:1], work, out, allow_changes=False)  # done at the other commit
    assert (out / "done").read_text() == "x"


def test_finished_weights_are_copied(tmp_path, monkeypatch):
    monkeypatch.setattr(recipe, "git_commit", lambda: "abc")
    work, out = tmp_path / "work", tmp_path / "out"
    make_weights([Stage("one", touch(work / "weights" / "a.npz"))], work, out, False)
    assert (out / "a.npz").read_text() == "x"


def test_a_changed_tree_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(recipe, "git_commit", lambda: "abc+changes")
    with pytest.raises(InputError, match="commit first"):
        make_weights([], tmp_path / "work", tmp_path / "out", allow_changes=False)
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize("flag", ["--labels", "--scans"])
def test_missing_data_are_noticed_before_anything_runs(tmp_path, monkeypatch, flag):
    monkeypatch.setattr(recipe, "make_weights", lambda *_: pytest.fail("too late"))
    words = [flag, str(tmp_path / "nothing"), "--workdir", str(tmp_path / "work")]
    with pytest.raises(InputError, match="nothing: expected a folder training/"):
        recipe.main(words)
    with pytest.raises(InputError, match="nothing"):
        recipe.main([*words, "--label_seqs", "all", "--scan_seqs", "all"])


def test_one_drive_cannot_calibrate(tiny_data, monkeypatch):
    monkeypatch.setattr(recipe, "make_weights", lambda *_: pytest.fail("too late"))
    words = ["--scans", str(tiny_data), "--scan_seqs", "0000", "--scan_val_seqs", "0001"]
    with pytest.raises(InputError, match="--scan_val_seqs: expected two or more drives"):
        recipe.main(words)


def test_a_begun_training_resumes(tmp_path):
    stage = Stage("train", ("train_det.py",), tmp_path)
    assert stage.arguments() == ["train_det.py"]
    (tmp_path / "config.json").write_text("{}")
    assert stage.arguments() == ["train_det.py", "--resume"]


@pytest.mark.parametrize("text", ["{", "[]", '{"a": 3}', "[" * 100_000, '{"a": {"command": []}}'])
def test_a_spoilt_record_is_named(tmp_path, text):
    (tmp_path / "recipe.json").write_text(text)
    with pytest.raises(InputError, match=r"recipe\.json: expected"):
        make_weights([], tmp_path, tmp_path / "out", allow_changes=True)


def refused(words: list[str], monkeypatch, match: str) -> None:
    monkeypatch.setattr(recipe, "make_weights", lambda *_: pytest.fail("too late"))
    with pytest.raises(InputError, match=match):
        recipe.main(words)


def test_labels_need_the_validation_sequence_and_another(tmp_path, monkeypatch):
    for seq in (0, 1, int(HELD_OUT)):
        write_sequence(tmp_path, seq, frames=1)
    words = ["--labels", str(tmp_path), "--label_seqs"]
    expected = "--label_seqs: expected 0011, which validates, and others to train on, found "
    for seqs in ("0000-0001", "0011"):
        refused([*words, seqs], monkeypatch, expected + seqs)
    refused([*words, "all"], monkeypatch, "--label_seqs: expected numbers such as 0001-0015")
    begun = []
    monkeypatch.setattr(recipe, "make_weights", lambda *values: begun.append(values))
    recipe.main([*words, "0000,0011"])
    assert len(begun) == 1
    (root,) = (r for r in RECIPE_VALUES["validation"] if r.get("needs") == "labels")
    assert root["seqs"] == HELD_OUT


def test_scans_that_train_do_not_validate(tiny_data, monkeypatch):
    words = ["--scans", str(tiny_data), "--scan_val_seqs", "0000,0001", "--scan_seqs"]
    refused([*words, "0000"], monkeypatch, "0000: expected either in --scan_seqs or in --scan_val")
    refused([*words, "all"], monkeypatch, "every labelled sequence is validated on")


def test_another_folder_than_the_root_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused([], monkeypatch, f"{tmp_path}: expected to be run in the project's root {ROOT}")
