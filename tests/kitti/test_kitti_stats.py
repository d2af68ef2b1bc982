"""Counts of a data set, and its command line."""

import json
import subprocess
import sys

import pytest
from helpers.kitti_rows import dont_care_row, label_row

from common import flags
from kitti.stats import main


def _counts(capsys, *argv):
    assert flags.run(main, [*argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_counts_by_hand(kitti_folder, capsys):
    kitti_folder([label_row(0, 1), label_row(1, 1), label_row(1, 2, "Van"), dont_care_row(4)])
    root = kitti_folder([label_row(0, 1), label_row(2, 5, "Cyclist")], seq=3)
    counts = _counts(capsys, "--data_root", str(root))
    assert counts["sequences"]["0003"] == {
        "frames": 3,
        "pairs": 2,
        "scans": 0,
        "classes": {
            "Car": {"trajectories": 1, "boxes": 1},
            "Cyclist": {"trajectories": 1, "boxes": 1},
            "Car+Van": {"trajectories": 1, "boxes": 1},
        },
    }
    assert (counts["overall"]["frames"], counts["overall"]["pairs"]) == (5 + 3, 4 + 2)
    assert counts["overall"]["classes"]["Car+Van"] == {"trajectories": 2 + 1, "boxes": 3 + 1}
    assert "DontCare" not in counts["overall"]["classes"]
    assert list(_counts(capsys, "--data_root", str(root), "--seqs", "3")["sequences"]) == ["0003"]


def test_a_half_sequence_has_the_frames_of_its_seqmap(kitti_folder, capsys):
    root = kitti_folder([label_row(t, 1) for t in range(6)])
    (root / "evaluate_tracking.seqmap").write_text("0000 empty 000002 000004\n")
    counts = _counts(capsys, "--data_root", str(root))["overall"]
    assert (counts["frames"], counts["pairs"]) == (3, 2)
    assert counts["classes"]["Car"] == {"trajectories": 1, "boxes": 3}


def test_table_shows_the_same(kitti_folder, capsys):
    root = kitti_folder([label_row(0, 1), label_row(1, 1), label_row(1, 2, "Van")])
    assert flags.run(main, ["--data_root", str(root)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["seq", "frames", "pairs", "scans", "Car", "Van", "Car+Van"]
    assert lines[1].split() == ["0000", "2", "1", "0", "1/2", "1/1", "2/3"]
    assert lines[2].split() == ["all", "2", "1", "0", "1/2", "1/1", "2/3"]


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--data_root", "nowhere"], "expected label files"),
        (["--data_root", "nowhere", "--seqs", "x"], "sequences: expected"),
        (["--data_root", "nowhere", "--seqs", "0"], "expected a folder training/"),
        (["--data_root"], "expected one argument"),
        (["--data_root", "nowhere", "--jso"], "unrecognized arguments: --jso"),
    ],
)
def test_bad_command_lines_are_one_line_and_code_2(tmp_path, argv, message):
    command = [sys.executable, "-m", "kitti.stats", *argv]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_kitti_needs_no_tensorflow():
    modules = ("iou", "labels", "scans", "sequence", "ground", "targets", "object_shift", "stats")
    code = "import sys\n" + "".join(f"import kitti.{name}\n" for name in modules)
    code += "assert not {'tensorflow', 'keras', 'scipy', 'pandas'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.real
def test_the_papers_figures(kitti_root, capsys):
    counts = _counts(capsys, "--data_root", str(kitti_root))
    overall = counts["overall"]
    assert (overall["frames"], overall["pairs"]) == (8008, 7987)
    assert overall["classes"]["Car+Van"] == {"trajectories": 636, "boxes": 30601}
    assert overall["classes"]["Car"] == {"trajectories": 579, "boxes": 27300}
    assert overall["classes"]["Van"] == {"trajectories": 57, "boxes": 3301}
    assert "Car" not in counts["sequences"]["0017"]["classes"]
    assert counts["sequences"]["0017"]["classes"]["Car+Van"] == {"trajectories": 0, "boxes": 0}
    validation = _counts(capsys, "--data_root", str(kitti_root), "--seqs", "0016-0020")["overall"]
    assert validation["classes"]["Car"] == {"trajectories": 142, "boxes": 8614}
    assert validation["classes"]["Car+Van"] == {"trajectories": 161, "boxes": 9921}
