"""evaluate.py end to end on a made-up folder."""

import json
import subprocess
import sys

import numpy as np
import pytest

import evaluate
from evaluate import EvaluateConfig
from kitti.boxes import project_boxes
from kitti.labels import read_results
from kitti.sequence import KittiSequence

TRACKERS = ("gt_displacement", "sort", "deep_sort", "ab3dmot")
TEN = ["MOTA", "MOTP", "MT", "ML", "IDS", "FRAG", "TP", "FP", "FN", "GT"]
ALL = "clear3d,kitti2d,kitti3d,hota"


def run(root, out, *argv) -> dict:
    """Calls main and returns metrics.json."""
    arguments = ["--data_root", root, "--seqs", "0000-0001", "--out", out, *argv]
    assert evaluate.main([str(value) for value in arguments]) is None
    return json.loads((out / "metrics.json").read_text())


def test_layout_of_metrics_json(tiny_root, tmp_path, capsys):
    record = run(tiny_root, tmp_path, "--tracker", "gt_displacement", "--protocol", ALL)
    assert list(record) == ["run", *ALL.split(",")]
    assert list(record["clear3d"]) == ["overall", "sequences"]
    for name in ("clear3d", "kitti2d"):
        assert list(record[name]["overall"]) == TEN
        assert list(record[name]["sequences"]) == ["0000", "0001"]
    assert list(record["kitti3d"]["overall"])[:13] == [*TEN, "sAMOTA", "AMOTA", "AMOTP"]
    assert {"HOTA", "DetA", "AssA", "IDF1"} <= set(record["hota"]["overall"])
    assert record["run"]["config"]["tracker"] == "gt_displacement"
    assert record["clear3d"]["sequences"]["0001"]["MOTA"] is None
    shown = capsys.readouterr().out
    assert "clear3d" in shown and "1.0000" in shown
    assert "| 0000" in (tmp_path / "table.md").read_text()


@pytest.mark.parametrize("tracker", TRACKERS)
def test_every_tracker_follows_steady_cars(tiny_root, tmp_path, tracker):
    figures = run(tiny_root, tmp_path, "--tracker", tracker)["clear3d"]["overall"]
    assert figures["GT"] == 3 * 12
    assert figures["IDS"] == 0 and figures["FP"] == 0
    assert figures["TP"] >= 3 * 9  # all but a probation


def test_result_files_hold_the_projected_boxes(tiny_root, tmp_path):
    run(tiny_root, tmp_path, "--tracker", "gt_displacement")
    sequence = KittiSequence(tiny_root, 0)
    rows = read_results(tmp_path / "tracks" / "0000.txt", sequence.num_frames)
    assert len(rows) == 36 and sorted(set(rows.type.tolist())) == ["Car", "Van"]
    expected = project_boxes(rows.boxes, sequence.calib, sequence.image_size)
    np.testing.assert_allclose(rows.bbox, expected, atol=1e-3)
    assert (tmp_path / "tracks" / "0001.txt").read_text() == ""


def test_results_evaluated_again_give_the_same_figures(tiny_root, tmp_path):
    argv = ("--protocol", ALL, "--iou", "0.25")
    first = run(tiny_root, tmp_path / "a", "--tracker", "ab3dmot", *argv)
    second = run(tiny_root, tmp_path / "b", "--results", tmp_path / "a" / "tracks", *argv)
    for name in ALL.split(","):
        assert first[name] == second[name]
    assert not (tmp_path / "b" / "tracks").exists()


def test_detection_files(tiny_root, tmp_path):
    argv = ("--detections", tiny_root / "detections", "--tracker", "gt_displacement")
    figures = run(tiny_root, tmp_path, *argv, "--classes", "Car")["clear3d"]["overall"]
    assert (figures["TP"], figures["FP"], figures["FN"], figures["GT"]) == (24, 0, 0, 24)


def test_detections_move_along_under_displacement(tiny_root, tmp_path):
    argv = ("--detections", tiny_root / "detections", "--tracker", "gt_displacement")
    moved = run(tiny_root, tmp_path, *argv, "--classes", "Car", "--displacement", "2")
    assert moved["clear3d"]["overall"]["TP"] == 24
    rows = read_results(tmp_path / "tracks" / "0000.txt")
    labels = KittiSequence(tiny_root, 0).objects
    shift = rows.at(3).boxes[0, :2] - labels.at(3).boxes[:2, :2]
    assert np.linalg.norm(shift, axis=1).min() > 1e-3  # no box stayed at its label


def test_displacement_follows_the_seed(tiny_root, tmp_path):
    def tracks(seed):
        argv = ("--tracker", "gt_displacement", "--displacement", "1", "--seed", seed)
        run(tiny_root, tmp_path, *argv)
        return (tmp_path / "tracks" / "0000.txt").read_text()

    assert tracks(1) == tracks(1) != tracks(2)


def test_classes_limit_both_sides(tiny_root, tmp_path):
    figures = run(tiny_root, tmp_path, "--classes", "Car")["clear3d"]["overall"]
    assert (figures["TP"], figures["FP"], figures["GT"]) == (24, 0, 24)


def test_score_threshold_of_boxes_from_files(tiny_root, tmp_path):
    argv = ("--detections", tiny_root / "detections", "--tracker", "sort", "--classes", "Car")
    kept = run(tiny_root, tmp_path, *argv, "--score_threshold", "5")["clear3d"]["overall"]
    dropped = run(tiny_root, tmp_path, *argv, "--score_threshold", "5.1")["clear3d"]["overall"]
    assert kept["TP"] > 0 and dropped["TP"] == 0
    assert (tmp_path / "tracks" / "0000.txt").read_text() == ""


def test_best_threshold_never_lowers_mota(tiny_root, tmp_path):
    folder = tmp_path / "theirs"
    run(tiny_root, folder, "--tracker", "gt_displacement")
    path = folder / "tracks" / "0000.txt"
    ghost = path.read_text().splitlines()[0].split()
    ghost[1], ghost[13], ghost[17] = "99", "30.0", "0.1"  # far aside, with a low score
    path.write_text(path.read_text() + " ".join(ghost) + "\n")
    argv = ("--results", folder / "tracks", "--protocol", "clear3d")
    everything = run(tiny_root, tmp_path / "a", *argv)["clear3d"]["overall"]
    best = run(tiny_root, tmp_path / "b", *argv, "--score_threshold", "best")["clear3d"]["overall"]
    assert (everything["FP"], best["FP"]) == (1, 0)
    assert best["MOTA"] == 1.0


def test_tracks_of_another_run_do_not_stay(tiny_root, tmp_path):
    """Those that its metrics.json names; a file that no run wrote stays."""
    (tmp_path / "tracks").mkdir()
    (tmp_path / "tracks" / "0007.txt").write_text("theirs")
    run(tiny_root, tmp_path)
    (tmp_path / "submission.zip").touch()  # of a run on the testing subset
    arguments = ["--data_root", str(tiny_root), "--seqs", "0001", "--out", str(tmp_path)]
    evaluate.main(arguments)
    assert not (tmp_path / "submission.zip").exists()
    assert {path.name for path in (tmp_path / "tracks").iterdir()} == {"0001.txt", "0007.txt"}


def test_tracks_do_not_stay_beside_metrics_of_others(tiny_root, tmp_path):
    run(tiny_root, tmp_path / "a")
    run(tiny_root, tmp_path / "b", "--tracker", "sort")
    run(tiny_root, tmp_path / "b", "--results", tmp_path / "b" / "tracks")
    assert (tmp_path / "b" / "tracks" / "0000.txt").is_file()
    run(tiny_root, tmp_path / "b", "--results", tmp_path / "a" / "tracks")
    assert not list((tmp_path / "b" / "tracks").iterdir())


def test_importable_without_files(tiny_root):
    config = EvaluateConfig(data_root=tiny_root, seqs=(0,), tracker="sort")
    record = evaluate.evaluate(config)
    assert record["clear3d"]["overall"]["GT"] == 36


def test_tensorflow_is_not_loaded(tiny_root, tmp_path):
    code = (
        "import re, sys, evaluate; evaluate.main(sys.argv[1:]); "
        # VmHWM is of this program alone; ru_maxrss keeps the parent's through fork and exec
        "peak = int(re.search(r'VmHWM:\\s*(\\d+) kB', open('/proc/self/status').read())[1]); "
        "print('tensorflow' in sys.modules, 'keras' in sys.modules, peak < 1_000_000)"
    )
    arguments = ["--data_root", tiny_root, "--seqs", "0000", "--out", tmp_path, "--protocol", ALL]
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        cwd=evaluate.__file__.rsplit("/", 1)[0],
    )
    assert done.stdout.splitlines()[-1] == "False False True"


@pytest.mark.real
@pytest.mark.slow
def test_validation_counts_on_real_labels(kitti_root, tmp_path):
    arguments = ["--data_root", kitti_root, "--classes", "Car", "--out", tmp_path]
    evaluate.main([*map(str, arguments), "--tracker", "gt_displacement", "--displacement", "2"])
    record = json.loads((tmp_path / "metrics.json").read_text())
    assert record["run"]["data"]["frames"] == 2589
    overall = record["clear3d"]["overall"]
    assert overall["GT"] == 8614
    assert overall["MOTA"] > 0.957
    assert record["clear3d"]["sequences"]["0017"]["MOTA"] is None


def test_written_config_is_read_again(tiny_root, tmp_path):
    run(
        tiny_root, tmp_path, "--tracker", "sort", "--object_shift", "1", "--score_threshold", "best"
    )
    written = ["--config", str(tmp_path / "config.json")]
    config = evaluate.parse_config(written)
    assert (config.tracker, config.object_shift, config.seqs) == ("sort", 1.0, (0, 1))
    assert (config.score_threshold, config.data_root) == ("best", tiny_root)
    assert evaluate.parse_config([*written, "--tracker", "ab3dmot"]).tracker == "ab3dmot"
