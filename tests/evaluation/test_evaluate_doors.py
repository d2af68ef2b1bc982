"""evaluate.py on unusual data: half sequences, other layouts, thresholds, classes."""

import gzip
import os
import shutil
import warnings

import numpy as np
import pytest
from helpers import tiny_kitti
from helpers.evaluate_run import run

import evaluate
from common import flags
from common.notes import note
from kitti.boxes import camera_from_level
from kitti.labels import read_labels, read_results, write_labels
from kitti.seqmap import SEQMAP
from metrics.protocols import PROTOCOLS

ALL = ",".join(PROTOCOLS)
TRACKERS = ("sort", "sort_image", "deep_sort", "ab3dmot", "gt_displacement")


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
