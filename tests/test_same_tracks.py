"""The library, track.py and evaluate.py give the same tracks for the same scans."""

import numpy as np
import pytest
from small_inputs import two_cars
from small_weights import write_weights

import evaluate
import track
from common import flags
from kitti.labels import read_results
from kitti.sequence import Sequence
from pointtracknet import Tracker


@pytest.mark.slow
def test_three_ways_to_the_same_tracks(tmp_path):
    weights = write_weights(tmp_path / "weights")
    root = two_cars().write_sequence(tmp_path / "data", frames=4)
    sequence = Sequence(root, 0)
    calib = root / "training" / "calib" / "0000.txt"
    scans = root / "training" / "velodyne" / "0000"
    argv = ["--scans", scans, "--calib", calib, "--weights", weights, "--out", tmp_path / "a"]
    assert flags.run(track.main, [str(a) for a in argv]) == 0
    argv = ["--data_root", root, "--seqs", "0000", "--weights", weights, "--out", tmp_path / "b"]
    argv += ["--detections", "network", "--tracker", "pointtracknet"]
    assert flags.run(evaluate.main, [str(a) for a in argv]) == 0
    by_track = (tmp_path / "a" / "0000.txt").read_text()
    assert by_track == (tmp_path / "b" / "tracks" / "0000.txt").read_text() != ""
    rows = read_results(tmp_path / "a" / "0000.txt")
    tracker = Tracker.load(weights, sequence.calib)
    for t in sequence.frames:
        tracks = tracker.update(track.Scans(scans).points(t))
        assert rows.at(t).track_id.tolist() == tracks.ids.tolist()
        np.testing.assert_allclose(rows.at(t).boxes[:, :6], tracks.boxes[:, :6], atol=1e-5)
