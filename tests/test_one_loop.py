"""The library, track.py and evaluate.py give the same tracks for the same scans."""

import json

import numpy as np
import pytest
from helpers.small_weights import write_weights

import evaluate
import track
from common import flags
from kitti.calibration import standard_mounting, write_calibration
from kitti.labels import read_results, write_labels
from kitti.objects import Objects
from kitti.scans.scan_files import read_scan, write_scan
from kitti.seqmap import write_seqmap
from models.weight_files import weights_sha256
from pointtracknet import Tracker

FRAMES = 4


@pytest.mark.parametrize("first", [0, 7])
def test_library_track_and_evaluate_agree(tmp_path, first):
    weights = write_weights(tmp_path / "weights")
    training = tmp_path / "kitti" / "training"
    scans, calib = training / "velodyne" / "0003", training / "calib" / "0003.txt"
    frames = range(first, first + FRAMES)
    for t in frames:
        rng = np.random.default_rng(t)
        points = rng.uniform((5, -5, -1.7, 0), (40, 5, 1, 1), (500, 4))
        points[:300, :3] = rng.uniform((18, -0.5, -1.5), (19, 0.5, -1), (300, 3))  # agree on a box
        write_scan(scans / f"{t:06d}.bin", points)
    write_calibration(calib, standard_mounting())
    write_labels(training / "label_02" / "0003.txt", Objects.empty())
    seqmap = write_seqmap(tmp_path / "kitti", "training", {3: frames.stop})
    seqmap.write_text(seqmap.read_text().replace("000000", f"{first:06d}"))

    words = ["--scans", scans, "--calib", calib, "--weights", weights, "--out", tmp_path / "track"]
    assert flags.run(track.main, [str(word) for word in words]) == 0
    words = ["--data_root", tmp_path / "kitti", "--seqs", "0003", "--detections", "network"]
    words += ["--tracker", "pointtracknet", "--weights", weights, "--out", tmp_path / "evaluate"]
    assert flags.run(evaluate.main, [str(word) for word in words]) == 0
    rows = (tmp_path / "track" / "0003.txt").read_text()
    assert rows == (tmp_path / "evaluate" / "tracks" / "0003.txt").read_text()
    run = json.loads((tmp_path / "evaluate" / "metrics.json").read_text())["run"]
    assert run["weights_sha256"] == weights_sha256(weights) != {}

    results = read_results(tmp_path / "track" / "0003.txt", frames.stop)
    assert len(results) >= FRAMES
    tracker = Tracker.load(weights, standard_mounting())
    for t in [*frames, *frames]:
        if t == first:
            tracker.reset()
            tracker.frame = t
        tracks = tracker.update(read_scan(scans / f"{t:06d}.bin"))
        expected = results.at(t)
        assert tracks.ids.tolist() == expected.track_id.tolist()
        assert tracks.types.tolist() == expected.type.tolist()
        assert tracks.boxes[:, :6] == pytest.approx(expected.boxes[:, :6], abs=1e-5)
        assert tracks.scores == pytest.approx(expected.score, abs=1e-5)
