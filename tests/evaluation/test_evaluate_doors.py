"""evaluate.py on unusual data: half sequences, other layouts, thresholds, classes."""

import gzip
import json
import os
import shutil
import warnings

import numpy as np
import pytest
from helpers import tiny_kitti

import evaluate
from common import flags
from common.notes import note
from kitti.boxes import camera_from_level
from kitti.labels import read_labels, read_results, write_labels
from kitti.seqmap import SEQMAP
from metrics.protocols import PROTOCOLS

ALL = ",".join(PROTOCOLS)
TRACKERS = ("sort", "sort_image", "deep_sort", "ab3dmot", "gt_displacement")


def run(root, out, *argv) -> dict:
    """Sequence 0000; returns metrics.json."""
    arguments = ["--data_root", root, "--seqs", "0000", "--out", out, *argv]
    assert evaluate.main([str(value) for value in arguments]) is None
    return json.loads((out / "metrics.json").read_text())


@pytest.fixture
def root(tmp_path):
    """A data set that a test may change."""
    return tiny_kitti.make(tmp_path / "kitti")


@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_half_sequence_is_a_sequence_of_its_own(root, tmp_path, tracker):
    """Frames 6 to 11 by the seqmap give the figures of a sequence that is cut and renumbered."""
    (root / "training" / f"{SEQMAP}.training").write_text("0000 empty 000006 000011\n")
    half = run(root, tmp_path / "half", "--tracker", tracker, "--protocol", ALL)
    assert half["run"]["data"]["frames"] == 6
    rows = read_results(tmp_path / "half" / "tracks" / "0000.txt")
    assert rows.frame.min() >= 6

    cut = tiny_kitti.make(tmp_path / "cut")
    label = cut / "training" / "label_02" / "0000.txt"
    labels = read_labels(label)
    labels = labels[labels.frame >= 6]
    labels.frame[:] -= 6
    write_labels(label, labels)
    (cut / "training" / f"{SEQMAP}.training").unlink()
    alone = run(cut, tmp_path / "alone", "--tracker", tracker, "--protocol", ALL)
    for name in PROTOCOLS:
        assert half[name] == alone[name], name


def test_results_of_the_whole_sequence_are_cut_to_the_half(root, tmp_path):
    run(root, tmp_path / "whole")
    (root / "training" / f"{SEQMAP}.training").write_text("0000 empty 000006 000011\n")
    figures = run(root, tmp_path / "half", "--results", tmp_path / "whole" / "tracks")
    assert figures["clear3d"]["overall"]["GT"] == figures["clear3d"]["overall"]["TP"] == 18


def test_poses_are_read_by_the_tracker_that_uses_them_alone(root, tmp_path, fails):
    (root / "poses").mkdir()
    (root / "poses" / "0000.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 5)
    assert run(root, tmp_path / "a", "--tracker", "sort")["clear3d"]["overall"]["TP"] > 0
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "b")
    assert "a pose per frame" in fails(*given, "--tracker", "ab3dmot")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_best_threshold_is_recorded_and_its_files_give_the_same_figures(root, tmp_path, protocol):
    good = (root / "detections" / "0000.txt").read_text().replace(",5.0000,", ",0.9,")
    ghosts = ""
    for line in good.splitlines()[::2]:
        words = line.split(",")
        words[2:6] = "20", "100", "60", "160"
        words[6], words[10] = "0.1", "-9.0"  # score and x: a false alarm aside of the road
        ghosts += ",".join(words) + "\n"
    folder = tmp_path / "detections"
    folder.mkdir()
    (folder / "0000.txt").write_text(good + ghosts)
    argv = ("--classes", "Car", "--protocol", protocol)
    with_best = ("--detections", folder, "--tracker", "sort", "--score_threshold", "best")
    best = run(root, tmp_path / "a", *with_best, *argv)
    threshold = best["run"]["min_track_score"]
    assert 0.1 < threshold < 0.95
    assert repr(threshold) in (tmp_path / "a" / "table.md").read_text()
    scores = read_results(tmp_path / "a" / "tracks" / "0000.txt").score
    assert len(scores) and scores.min() > 0.5
    again = run(root, tmp_path / "b", "--results", tmp_path / "a" / "tracks", *argv)
    assert again[protocol] == best[protocol]


def test_best_of_result_files_writes_the_tracks_that_it_keeps(root, tmp_path, fails):
    run(root, tmp_path / "a", "--tracker", "sort")
    path = tmp_path / "a" / "tracks" / "0000.txt"
    ghost = path.read_text().splitlines()[0].split()
    ghost[1], ghost[13], ghost[17] = "99", "30.0", "0.1"  # far aside, with a low score
    path.write_text(path.read_text() + " ".join(ghost) + "\n")
    best = ("--results", path.parent, "--score_threshold", "best")
    kept = run(root, tmp_path / "b", *best)
    assert kept["clear3d"]["overall"]["FP"] == 0
    again = run(root, tmp_path / "c", "--results", tmp_path / "b" / "tracks")
    assert again["clear3d"] == kept["clear3d"]
    given = ("--data_root", root, "--seqs", "0000", *best)
    error = fails(*given, "--out", tmp_path / "a")
    assert "its result files would replace those that are read" in error
    assert "99 Car" in path.read_text()
    path.write_text("\n".join(line.rsplit(" ", 1)[0] for line in path.read_text().splitlines()))
    assert "expected scores in the results" in fails(*given, "--out", tmp_path / "d")


def test_the_image_size_is_shown_and_can_be_given(root, tmp_path, fails, capsys):
    note.cache_clear()
    path = root / "training" / "calib" / "0000.txt"
    text = path.read_text()
    assert run(root, tmp_path / "a")["run"]["data"]["image_size"] == {"0000": [1242, 375]}
    assert "pixels" not in capsys.readouterr().err
    lines = [line for line in text.splitlines() if not line.startswith("P2")]
    path.write_text("\n".join([*lines, "P2: 700 0 300 0 0 700 90 0 0 0 1 0\n"]))
    assert run(root, tmp_path / "b")["run"]["data"]["image_size"] == {"0000": [600, 180]}
    notes = capsys.readouterr().err
    assert f"{path}: images of 600x180 pixels, twice the principal point of P2" in notes
    given = run(root, tmp_path / "c", "--image_size", "640x200")
    assert given["run"]["data"]["image_size"] == {"0000": [640, 200]}
    assert "twice" not in capsys.readouterr().err
    run(root, tmp_path / "d", "--config", tmp_path / "c" / "config.json")
    assert (tmp_path / "d" / "tracks" / "0000.txt").read_text() == (
        tmp_path / "c" / "tracks" / "0000.txt"
    ).read_text()
    path.write_text("\n".join([*lines, "P2: 700 0 -20 0 0 700 100 0 0 0 1 0\n"]))
    words = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "e")
    assert f"{path}: the principal point (-20, 100) of P2 is in no image" in fails(*words)
    assert "--image_size: expected pixels" in fails(*words, "--image_size", "big")


def test_detections_per_frame_give_the_tracks_of_those_per_sequence(root, tmp_path):
    rows = read_labels(root / "training" / "label_02" / "0000.txt").of_classes(("Car",))
    camera = np.stack(camera_from_level(rows.boxes), axis=1)
    folder = tmp_path / "frames" / "0000"
    folder.mkdir(parents=True)
    for t in range(12):
        lines = [
            f"car 0 0 0 {' '.join(f'{v:.4f}' for v in (*bbox, *box))} 5.0\n"
            for bbox, box in zip(rows.bbox[rows.frame == t], camera[rows.frame == t], strict=True)
        ]
        (folder / f"{t:06d}.txt").write_text("".join(lines))
    argv = ("--tracker", "ab3dmot", "--classes", "car")
    run(root, tmp_path / "a", *argv, "--detections", tmp_path / "frames")
    run(root, tmp_path / "b", *argv, "--detections", root / "detections")
    texts = [(tmp_path / name / "tracks" / "0000.txt").read_text() for name in "ab"]
    assert texts[0] == texts[1] != ""


@pytest.mark.parametrize("below", ["data", "data_0", "tracks"])
def test_results_and_detections_below_are_found(root, tmp_path, below):
    """TrackEval keeps result files in data/, AB3DMOT in data_0/, evaluate.py in tracks/."""
    whole = run(root, tmp_path / "whole")
    folder = tmp_path / "theirs" / below
    shutil.copytree(tmp_path / "whole" / "tracks", folder)
    again = run(root, tmp_path / "again", "--results", folder.parent)
    assert again["clear3d"] == whole["clear3d"]
    shutil.copy(root / "detections" / "0000.txt", folder)
    run(root, tmp_path / "b", "--tracker", "sort", "--detections", folder.parent)
    run(root, tmp_path / "c", "--tracker", "sort", "--detections", root / "detections")
    texts = [(tmp_path / name / "tracks" / "0000.txt").read_text() for name in "bc"]
    assert texts[0] == texts[1] != ""


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


def test_a_root_that_is_another_folder_is_named(root, tmp_path, fails):
    def told(data_root) -> str:
        return fails("--seqs", "0000", "--out", tmp_path / "a", "--data_root", data_root)

    assert "; there is one in kitti/: give that folder" in told(root.parent)
    other = shutil.copytree(root / "training", tmp_path / "labels_and_calib")
    assert "in KITTI's layout: label_02/ belongs into training/" in told(other)
    shutil.copytree(root, tmp_path / "data_tracking_calib")
    assert "; there is one in data_tracking_calib/ and 1 others: put them into" in told(tmp_path)
    (root / "training" / "label_02").rename(root / "training" / "label_2")
    assert "has no label file; label_2/ is the object benchmark's" in told(root)


def test_the_folder_of_the_subset_is_not_the_root(root, tmp_path, fails):
    given = ("--seqs", "0000", "--out", tmp_path / "a", "--data_root", root / "training")
    assert "expected a folder training/ in KITTI's layout: give the folder above" in fails(*given)


@pytest.mark.parametrize("protocol", ["kitti2d", "kitti3d", "hota"])
def test_pedestrians_are_evaluated_and_other_classes_refused(root, tmp_path, fails, protocol):
    labels = root / "training" / "label_02" / "0000.txt"
    labels.write_text(labels.read_text().replace("Car", "Pedestrian"))
    argv = ("--classes", "pedestrian", "--protocol", protocol)
    overall = run(root, tmp_path / "a", "--tracker", "gt_displacement", *argv)[protocol]["overall"]
    assert overall.get("MOTA", overall.get("HOTA")) == pytest.approx(1.0)
    shutil.rmtree(tmp_path / "a")
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "a")
    for classes in ("Tram", "Car,Pedestrian"):
        message = fails(*given, "--classes", classes, "--protocol", protocol)
        assert f"--classes: {protocol} evaluates one class of Car, Pedestrian" in message
    assert not (tmp_path / "a").exists()


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


def test_detections_that_go_on_after_the_labels(root, tmp_path, fails):
    (root / "training" / f"{SEQMAP}.training").unlink()
    path = root / "detections" / "0000.txt"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1].replace("11,", "12,", 1))
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "a", "--tracker", "sort")
    message = fails(*given, "--detections", root / "detections")
    assert "expected 0 to 11, where the labels" in message and "seqmap sets the frames" in message


@pytest.mark.parametrize("argv", [("--detections", "network"), ("--tracker", "pointtracknet")])
def test_networks_without_any_scan_are_refused(root, tmp_path, fails, argv):
    scans = root / "training" / "velodyne" / "0000"
    scans.mkdir(parents=True)
    (scans / "0000000000.bin").touch()  # a name of the raw data
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "out", *argv)
    assert "0000: expected scans such as 000000.bin to 000011.bin, found none" in fails(*given)
    assert not list((tmp_path / "out").rglob("*.txt"))


def test_switches_between_the_largest_ids_are_counted(root, tmp_path):
    """Each vehicle's id changes by one in frame 6, at the end of what 64 bits hold."""
    run(root, tmp_path / "whole")
    path = tmp_path / "whole" / "tracks" / "0000.txt"
    words = [line.split(" ") for line in path.read_text().splitlines()]
    for row in words:
        row[1] = str(2**63 - 1 - 2 * int(row[1]) - (int(row[0]) >= 6))
    path.write_text("".join(" ".join(row) + "\n" for row in words))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figures = run(root, tmp_path / "again", "--results", path.parent, "--protocol", ALL)
    assert [figures[name]["overall"]["IDS"] for name in ("clear3d", "kitti2d")] == [3, 2]


def test_out_may_have_a_name_that_is_no_text(root, tmp_path, monkeypatch):
    out = tmp_path / os.fsdecode(b"o\xff")
    argv = [str(word) for word in ("--data_root", root, "--seqs", "0000", "--out", out)]
    monkeypatch.setattr("sys.argv", ["evaluate.py", *argv])  # in table.md
    assert flags.run(evaluate.main) == 0
    assert {path.name for path in out.iterdir()} >= {"metrics.json", "config.json"}
    assert b"o\xff" in (out / "table.md").read_bytes()
    again = ["--config", out / "config.json", "--results", out / "tracks"]
    assert flags.run(evaluate.main, [str(word) for word in again]) == 0


def test_compressed_results_are_read(root, tmp_path):
    whole = run(root, tmp_path / "whole")
    path = tmp_path / "whole" / "tracks" / "0000.txt"
    path.with_name("0000.txt.gz").write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()
    again = run(root, tmp_path / "again", "--results", path.parent)
    assert again["clear3d"] == whole["clear3d"]


def test_a_threshold_on_results_without_scores_is_refused(root, tmp_path, fails):
    run(root, tmp_path / "whole")
    path = tmp_path / "whole" / "tracks" / "0000.txt"
    lines = [line.rpartition(" ")[0] for line in path.read_text().splitlines()]
    path.write_text("".join(line + "\n" for line in lines))
    given = ("--data_root", root, "--seqs", "0000", "--out", tmp_path / "b")
    message = fails(*given, "--results", path.parent, "--score_threshold", "0.5")
    assert "expected scores in the results, sequence 0000 has none" in message
