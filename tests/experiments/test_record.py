"""Records name the networks, thresholds, configurations and data that were measured with."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import evaluate_networks
from experiments.record import config_records, data_record, measured_with
from experiments.runs import Run, details_of
from models.boxes.box_score import BoxScorer, save_scorer
from models.weight_files import weights_sha256


@pytest.fixture
def weights(tmp_path) -> Path:
    """Files in place of the networks, and a scorer whose threshold is 0.25."""
    for name in ("detector.npz", "tracker.npz"):
        (tmp_path / name).write_bytes(name.encode())
    save_scorer(tmp_path, BoxScorer("0", 0.25, 0.0, ("points",), (0.0,), (1.0,), (1.0,)))
    return tmp_path


def test_hashes_are_of_both_networks_and_the_scorer(weights):
    found = weights_sha256(weights)
    assert list(found) == ["detector.npz", "tracker.npz", "scorer.json"]
    assert found["tracker.npz"] == hashlib.sha256(b"tracker.npz").hexdigest()
    (weights / "scorer.json").unlink()
    assert list(weights_sha256(weights)) == ["detector.npz", "tracker.npz"]


def test_simulated_data_have_version_and_seed(tiny_root, tmp_path):
    assert data_record(tiny_root, (0, 1)) == {
        "data_root": str(tiny_root),
        "sequences": {"0000": 12, "0001": 5},
        "simulated": None,
    }
    for name in ("training", "evaluate_tracking.seqmap.training"):
        (tmp_path / name).symlink_to(tiny_root / name)
    (tmp_path / "manifest.json").write_text('{"version": 3, "driver": "town", "seed": 7}')
    assert data_record(tmp_path, (0,))["simulated"] == {"version": 3, "seed": 7}


def test_configurations_of_a_table(tiny_root, weights):
    base = Run(tiny_root, (0,), ("Car",), "sort", object_shift=2.0, weights=weights)
    rows = [
        replace(base, detections=detections, tracker=tracker)
        for detections in ("gt", "network")
        for tracker in ("sort", "ab3dmot")
    ]
    record = details_of(rows, 2)
    assert [(c["detections"], c["min_box_score"]) for c in record["configs"]] == [
        ("gt", None),
        ("network", 0.25),
    ]
    assert all(c["trackers"] == ["sort", "ab3dmot"] for c in record["configs"])
    assert all(c["seeds"] == [0, 1] and c["object_shift"] == 2.0 for c in record["configs"])
    assert [part["sequences"] for part in record["data"]] == [{"0000": 12}]
    assert set(record["weights_sha256"]) == {"detector.npz", "tracker.npz", "scorer.json"}
    assert "weights_sha256" not in measured_with([base.config])  # labels alone


def test_every_configuration_of_the_networks_is_recorded(tiny_root, weights, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluate_networks, "measure", lambda config, *_: {"MOTA": config.seed})
    words = ["--data_root", tiny_root, "--seqs", "0000", "--weights", weights, "--seeds", "2"]
    evaluate_networks.main([str(word) for word in (*words, "--out", tmp_path / "out")])
    run = json.loads((tmp_path / "out" / "networks.json").read_text())["run"]
    found = {(c["object_shift"], c["detections"], c["iou"]): c for c in run["configs"]}
    kinds = [("network", 0.25), ("network", 0.5), ("gt", 0.5)]
    assert list(found) == [(d, *kind) for d in (0.0, 2.0) for kind in kinds]
    assert found[0.0, "network", 0.5]["protocols"] == ["clear3d", "clear3d_dontcare", "kitti3d"]
    assert found[2.0, "network", 0.5]["protocols"] == ["clear3d", "clear3d_dontcare"]
    assert found[2.0, "network", 0.25]["seeds"] == [0, 1]
    assert found[0.0, "network", 0.25]["min_box_score"] == 0.25
    assert run["data"][0]["sequences"] == {"0000": 12} and "tracker.npz" in run["weights_sha256"]


def test_configurations_that_differ_in_more_than_tracker_and_seed_stay_apart(tiny_root):
    configs = [Run(tiny_root, (0,), ("Car",), "sort", object_shift=d).config for d in (0.0, 1.0)]
    assert [c["object_shift"] for c in config_records(configs)] == [0.0, 1.0]
