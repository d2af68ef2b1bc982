"""Bad input to evaluate.py: one line, exit code 2, nothing half-written."""

import json
import os
from pathlib import Path

import pytest
from helpers import tiny_kitti

ROW = "0 1 Car 0 0 -1.5 100 120 200 180 1.5 1.6 4.0 2.0 1.7 20.0 0.3 0.9"


@pytest.fixture
def theirs(tmp_path) -> Path:
    """Result files of another tracker, both sequences, one row."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    (folder / "0000.txt").write_text(ROW + "\n")
    (folder / "0001.txt").write_text("")
    return folder


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("wrong columns", ROW + "\n1 1 Car 0 0\n", 2),
        (
            "no score in one row",
            ROW + "\n" + ROW.replace("0 1", "1 1", 1).rsplit(" ", 1)[0] + "\n",
            2,
        ),
        ("duplicate id", ROW + "\n" + ROW + "\n", 2),
        ("beyond the sequence", ROW.replace("0 1", "12 1", 1) + "\n", 1),
        ("NaN", ROW.replace("20.0", "nan") + "\n", 1),
        ("infinite", ROW.replace("20.0", "inf") + "\n", 1),
        ("negative size", ROW.replace("1.6", "-1.6") + "\n", 1),
        ("unknown class", ROW.replace("Car", "Boat") + "\n", 1),
        ("not a number", ROW.replace("20.0", "far") + "\n", 1),
        ("cut off", ROW + "\n" + ROW.replace("0 1", "1 1", 1)[:30], 2),
    ],
)
def test_result_files(tiny_root, tmp_path, theirs, fails, name, text, line):
    path = theirs / "0000.txt"
    path.write_text(text)
    out = tmp_path / "out"
    arguments = ("--data_root", tiny_root, "--seqs", "0000-0001", "--out", out)
    assert f"{path}:{line}:" in fails(*arguments, "--results", theirs)
    assert not out.exists()


def test_result_file_that_is_not_text(tiny_root, tmp_path, theirs, fails):
    (theirs / "0000.txt").write_bytes(b"\xfd\xfe" + ROW.encode())
    arguments = ("--data_root", tiny_root, "--seqs", "0000", "--out", tmp_path / "out")
    assert "0000.txt:1:" in fails(*arguments, "--results", theirs)


def test_directory_where_a_file_is_due(tiny_root, tmp_path, theirs, fails):
    (theirs / "0000.txt").unlink()
    (theirs / "0000.txt").mkdir()
    arguments = ("--data_root", tiny_root, "--seqs", "0000", "--out", tmp_path / "out")
    assert "directory" in fails(*arguments, "--results", theirs)


def test_missing_result_file_and_folder(tiny_root, tmp_path, theirs, fails):
    (theirs / "0001.txt").unlink()
    arguments = ("--data_root", tiny_root, "--seqs", "0000-0001", "--out", tmp_path / "out")
    assert "0001.txt" in fails(*arguments, "--results", theirs)
    assert "expected a directory" in fails(*arguments, "--results", theirs / "0000.txt")
    assert "expected a directory" in fails(*arguments, "--detections", tmp_path / "nowhere")


@pytest.mark.parametrize("below", ["", "tracks"])
def test_detections_are_not_replaced_by_the_tracks_of_them(tiny_root, tmp_path, fails, below):
    (tmp_path / "tracks").mkdir()
    path = tmp_path / "tracks" / "0000.txt"
    path.write_text((tiny_root / "detections" / "0000.txt").read_text())
    given = ("--data_root", tiny_root, "--seqs", "0000", "--out", tmp_path, "--tracker", "sort")
    message = fails(*given, "--detections", tmp_path / below)
    assert "tracks: --out: its result files would replace those that are read" in message
    assert path.read_text() == (tiny_root / "detections" / "0000.txt").read_text()


@pytest.mark.parametrize("inside", ["detections", "training/label_02"])
def test_inputs_are_not_replaced_by_the_output(tmp_path, fails, inside):
    """Directly, or through a link: tracks/ of the output folder is the folder that is read."""
    root = tiny_kitti.make(tmp_path / "kitti")
    (root / inside).rename(tmp_path / "tracks")
    (root / inside).symlink_to(tmp_path / "tracks")
    before = {path: path.read_text() for path in (tmp_path / "tracks").iterdir()}
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path, "--tracker", "sort")
    message = fails(*given, "--detections", root / "detections")
    assert "tracks: --out: its result files would replace those that are read" in message
    assert {path: path.read_text() for path in (tmp_path / "tracks").iterdir()} == before


def test_bad_detections_are_found_before_any_work(tiny_root, tmp_path, fails):
    folder = tmp_path / "detections"
    folder.mkdir()
    good = (tiny_root / "detections" / "0000.txt").read_text()
    (folder / "0000.txt").write_text(good)
    (folder / "0001.txt").write_text(good.splitlines()[0] + ",7\n")
    out = tmp_path / "out"
    arguments = ("--data_root", tiny_root, "--seqs", "0000-0001", "--out", out, "--tracker", "sort")
    assert "0001.txt:1:" in fails(*arguments, "--detections", folder)
    assert not out.exists()


def test_bad_labels(tmp_path, fails):
    root = tiny_kitti.make(tmp_path / "kitti")
    path = root / "training" / "label_02" / "0000.txt"
    path.write_text(path.read_text().replace("Van", "Boat"))
    out = tmp_path / "out"
    message = fails("--data_root", root, "--seqs", "0000", "--out", out)
    assert "0000.txt:" in message and "Boat" in message
    assert not out.exists()


def test_missing_calibration_key(tmp_path, fails):
    root = tiny_kitti.make(tmp_path / "kitti")
    path = root / "training" / "calib" / "0000.txt"
    path.write_text("".join(line for line in path.open() if not line.startswith("P2")))
    assert "P2" in fails("--data_root", root, "--seqs", "0000", "--out", tmp_path / "out")


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--trackers", "sort"], "unrecognized"),
        (["--track", "sort"], "unrecognized"),  # no abbreviations
        (["--tracker", "kalman"], "--tracker"),
        (["--protocol", "clear2d"], "--protocol"),
        (["--protocol", "clear3d,clear3d"], "--protocol"),
        (["--classes", "Car,Boat"], "--classes"),
        (["--classes", ""], "--classes"),
        (["--seqs", "16-"], "sequences"),
        (["--seqs", "0003"], "0003"),
        (["--iou", "0"], "--iou"),
        (["--iou", "nan"], "--iou"),
        (["--displacement", "-1"], "--displacement"),
        (["--displacement", "inf"], "--displacement"),
        (["--object_shift", "-1"], "--object_shift"),
        (["--object_shift", "1e15"], "--object_shift: expected 0.0 to 1000.0"),
        (["--score_threshold", "1e308"], "--score_threshold: expected -1000000000000000.0 to"),
        (["--displacement", "1", "--protocol", "kitti2d"], "--object_shift"),
        (["--seed", "-1"], "--seed"),
        (["--seed", str(2**63)], "--seed"),
        (["--score_threshold", "good"], "--score_threshold"),
        (["--score_threshold", "nan"], "--score_threshold"),
        (["--subset", "validation"], "--subset"),
        (["--results", "x", "--tracker", "sort"], "--results"),
        (["--data_root", "/nowhere"], "nowhere"),
    ],
)
def test_flags(tiny_root, tmp_path, fails, flags, message):
    out = tmp_path / "out"
    given = ["--data_root", tiny_root, "--seqs", "0000", "--out", out]
    assert message in fails(*given, *flags)
    assert not out.exists()


@pytest.mark.parametrize("field", ["data_root", "detections", "results", "weights", "out"])
@pytest.mark.parametrize("value", ["\0", "a\ud800"])
def test_paths_of_a_file_that_no_path_can_be(tiny_root, tmp_path, fails, field, value):
    file = tmp_path / "settings.json"
    settings = {"data_root": str(tiny_root), "out": str(tmp_path / "out"), field: value}
    file.write_text(json.dumps(settings))
    message = fails("--config", file, "--seqs", "0000", "--tracker", "sort")
    assert f"settings.json: --{field}: expected text without NUL or lone surrogates" in message


@pytest.mark.parametrize("seqs", [[0, 0], [1, 0, 1], [10_000], [-1]])
def test_sequences_of_a_file_are_there_once(tiny_root, tmp_path, fails, seqs):
    """A sequence that is there twice would count twice."""
    out, file = tmp_path / "out", tmp_path / "settings.json"
    file.write_text(json.dumps({"seqs": seqs}))
    message = fails("--config", file, "--data_root", tiny_root, "--out", out)
    assert (
        f"settings.json: --seqs: expected numbers from 0 to 9999, each once, found {seqs}"
        in message
    )
    assert not out.exists()


@pytest.mark.parametrize(
    "flags",
    [
        ["--detections", "gt"],
        ["--detections", "x", "--tracker", "gt_displacement"],
        ["--detections", "x", "--tracker", "sort", "--protocol", "clear3d"],
        ["--results", "x"],
        ["--detections", "x", "--tracker", "sort", "--displacement", "1"],
    ],
)
def test_testing_subset_has_no_labels(tiny_root, tmp_path, fails, flags):
    given = ["--data_root", tiny_root, "--subset", "testing", "--out", tmp_path / "out"]
    assert "testing" in fails(*given, *flags)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--results", "no/results"], "no/results"),
        (["--detections", "no/detections", "--tracker", "sort"], "no/detections"),
        (["--detections", "network", "--tracker", "sort"], "expected scans"),
    ],
)
def test_a_refused_run_leaves_no_folder(tiny_root, tmp_path, fails, argv, message):
    out = tmp_path / "new" / "out"
    assert message in fails("--data_root", tiny_root, "--seqs", "0000", "--out", out, *argv)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["file/out", "x" * 300, "loop/out"])
def test_out_that_cannot_be_made_is_refused_before_the_work(tiny_root, tmp_path, fails, name):
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    given = ("--data_root", tiny_root, "--seqs", "0000", "--results", "no/results")
    assert "--out: cannot be written" in fails(*given, "--out", tmp_path / name)


def test_out_that_is_a_file(tiny_root, tmp_path, fails):
    out = tmp_path / "out"
    out.write_text("mine")
    assert "--out" in fails("--data_root", tiny_root, "--seqs", "0000", "--out", out)
    assert out.read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_out_without_permission(tiny_root, tmp_path, fails):
    tmp_path.chmod(0o555)
    try:
        assert "--out" in fails(
            "--data_root", tiny_root, "--seqs", "0000", "--out", tmp_path / "out"
        )
    finally:
        tmp_path.chmod(0o755)


def test_out_in_a_folder_that_takes_no_files(tiny_root, fails):
    assert "--out" in fails("--data_root", tiny_root, "--seqs", "0000", "--out", "/proc/out")
