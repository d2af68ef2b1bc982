"""evaluate.py notes what looks like a mistake in its inputs, and goes on."""

import shutil

import numpy as np
import pytest
from helpers.evaluate_run import run

from common.notes import note


def changed(root, change) -> str:
    """The detections of sequence 0000 with other x y z ry, by h and these."""
    lines = []
    for line in (root / "detections" / "0000.txt").read_text().splitlines():
        words = line.split(",")
        words[10:14] = map(str, change(float(words[7]), *map(float, words[10:14])))
        lines.append(",".join(words) + "\n")
    return "".join(lines)


@pytest.mark.parametrize(
    "change",
    [
        lambda h, x, y, z, ry: (z, -x, h / 2 - y, -ry - np.pi / 2),  # scanner's
        lambda h, x, y, z, ry: (x, y - h / 2, z, ry),  # centre, not bottom
        lambda h, x, y, z, ry: (x + 5, y, z, ry),  # of another calibration
    ],
)
def test_boxes_of_another_frame_are_noted(root, tmp_path, capsys, change):
    argv = ("--tracker", "sort", "--detections", root / "detections")
    run(root, tmp_path / "a", *argv)
    assert "note" not in capsys.readouterr().err
    path = root / "detections" / "0000.txt"
    path.write_text(changed(root, change))
    run(root, tmp_path / "a", *argv)
    seen = f"{path.parent}: the 3-D boxes do not project to the 2-D boxes (median IoU 0."
    assert seen in capsys.readouterr().err


def test_boxes_out_of_view_are_noted_where_no_2d_boxes_tell(root, tmp_path, capsys):
    path = root / "detections" / "0000.txt"
    path.write_text(changed(root, lambda h, x, y, z, ry: (z, -x, h / 2 - y, -ry - np.pi / 2)))
    rows = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("".join(",".join([*r[:2], *"0000", *r[6:]]) + "\n" for r in rows))
    run(root, tmp_path / "a", "--tracker", "sort", "--detections", path.parent)
    seen = f"{path.parent}: {len(rows)} of {len(rows)} boxes lie outside the camera's view"
    assert seen in capsys.readouterr().err


def test_a_few_boxes_out_of_view_among_others_are_no_fault(root, tmp_path, capsys):
    path = root / "detections" / "0000.txt"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    behind = [[*r[:2], *"0000", *r[6:12], "-20", *r[13:]] for r in rows[:12]]
    assert len(rows) > 20
    path.write_text("".join(",".join(r) + "\n" for r in [*rows, *behind]))
    run(root, tmp_path / "a", "--tracker", "sort", "--detections", path.parent)
    assert "outside the camera's view" not in capsys.readouterr().err


@pytest.mark.parametrize("shift", [1, -1])
def test_frames_counted_from_another_number_are_noted(root, tmp_path, capsys, shift):
    run(root, tmp_path / "a", "--tracker", "gt_displacement")
    path = tmp_path / "a" / "tracks" / "0000.txt"
    rows = [line.split(" ", 1) for line in path.read_text().splitlines()]
    moved = [(int(frame) + shift, rest) for frame, rest in rows]
    path.write_text("".join(f"{t} {rest}\n" for t, rest in moved if 0 <= t < 12))
    assert "note" not in capsys.readouterr().err
    run(root, tmp_path / "b", "--results", path.parent)
    seen = (
        f"the boxes of frame t fit the labels of frame t{-shift:+d} better (median distance 0.00 m"
    )
    assert seen in capsys.readouterr().err


@pytest.mark.parametrize(
    "sizes", ["0 0 0 0 0 0 0", "-1 -1 -1 -1 -1 -1 -1", "-1000 -1000 -1000 -10 -1 -1 -1"]
)
def test_2d_trackers_may_write_any_box_of_no_size(root, tmp_path, capsys, sizes):
    whole = run(root, tmp_path / "a", "--tracker", "sort", "--protocol", "kitti2d")
    path = tmp_path / "a" / "tracks" / "0000.txt"
    rows = [line.split() for line in path.read_text().splitlines()]
    path.write_text("".join(" ".join([*r[:10], sizes, r[17]]) + "\n" for r in rows))
    flat = run(root, tmp_path / "b", "--results", path.parent, "--protocol", "kitti2d")
    assert flat["kitti2d"] == whole["kitti2d"]
    run(root, tmp_path / "c", "--detections", path.parent, "--tracker", "sort")
    noted = f"{path}: {len(rows)} of {len(rows)} rows have no 3-D box and are left out"
    assert noted in capsys.readouterr().err


def test_frames_without_a_file_of_detections_are_noted(root, tmp_path, capsys):
    folder = tmp_path / "frames" / "0000"
    folder.mkdir(parents=True)
    for t in range(10):
        (folder / f"{t:06d}.txt").write_text("")
    argv = ("--tracker", "sort", "--detections", folder.parent)
    run(root, tmp_path / "a", *argv)
    assert f"{folder}: 2 of 12 frames have no file, and so no detection" in capsys.readouterr().err


def test_boxes_that_can_match_nothing_are_noted(root, tmp_path, capsys):
    """Of other classes than those evaluated, or of a 2-D tracker under a 3-D protocol."""
    results = tmp_path / "theirs"
    results.mkdir()
    row = "0 1 Pedestrian 0 0 -1.5 100 120 200 180 {} 0.9\n"
    (results / "0000.txt").write_text(row.format("1.7 0.6 0.6 2.0 1.7 20.0 0.3"))
    other = "no box is of --classes Car,Van, all are Pedestrian"
    run(root, tmp_path / "a", "--results", results)
    assert f"{results}: {other}" in capsys.readouterr().err
    boxes = shutil.copytree(results, tmp_path / "boxes")
    run(root, tmp_path / "a", "--detections", boxes, "--tracker", "sort")
    assert f"{boxes}: {other}" in capsys.readouterr().err
    flat = row.format("-1 -1 -1 -1000 -1000 -1000 -10").replace("Pedestrian", "Car")
    (results / "0000.txt").write_text(flat)
    run(root, tmp_path / "a", "--results", results, "--protocol", "kitti2d")
    assert "2-D alone" not in capsys.readouterr().err
    run(root, tmp_path / "a", "--results", results, "--protocol", "kitti2d,clear3d")
    assert "1 of 1 boxes are 2-D alone and match nothing in clear3d" in capsys.readouterr().err


def test_what_holds_nothing_to_evaluate_is_noted(root, tmp_path, capsys, fails):
    empty = tmp_path / "empty"
    empty.mkdir()
    (empty / "0000.txt").touch()
    for flag in ("--results", "--detections"):
        more = ("--tracker", "sort") if flag == "--detections" else ()
        run(root, tmp_path / "a", flag, empty, *more)
        assert f"{empty}: there is no box in it" in capsys.readouterr().err
        note.cache_clear()
    run(root, tmp_path / "a", "--classes", "Tram")
    assert f"{root}: no box is of --classes Tram, all are Car, Van" in capsys.readouterr().err
    given = ("--data_root", root, "--seqs", "0000,0001", "--out", tmp_path / "b")
    message = fails(*given, "--results", empty)
    assert f"{empty}: expected a result file 0001.txt for each of --seqs" in message


def test_a_threshold_above_all_scores_is_noted(root, tmp_path, capsys):
    """Such as one in per cent; the detections have score 5."""
    argv = ("--detections", root / "detections", "--tracker", "sort")
    run(root, tmp_path / "a", *argv, "--score_threshold", "5")
    assert "note" not in capsys.readouterr().err
    again = ("--results", tmp_path / "a" / "tracks", "--score_threshold", "6")
    for given in ((*argv, "--score_threshold", "50"), again):
        run(root, tmp_path / "b", *given)
        expected = f"--score_threshold {given[-1]}: all scores are lower, the greatest is 5\n"
        assert expected in capsys.readouterr().err
