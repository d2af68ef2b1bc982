"""The number of weights of a network, counted before it is built."""

import dataclasses
import json

import numpy as np
import pytest
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER, tracker_with
from helpers.small_weights import write_weights
from helpers.two_cars import write_sequence

import train_det
import train_track
from common.errors import InputError
from common.flags import run
from models import checkpoint
from models.config import DetectorConfig, TrackerConfig
from models.detector import POINT_FEATURES, Detector
from models.tracker import TrackingNetwork
from models.weight_count import detector_weights, tracker_weights
from models.weights import load_detector, load_tracker

WIDE = [8192] * 64


def size(network) -> int:
    return sum(int(np.prod(variable.shape)) for variable in network.weights)


@pytest.mark.parametrize(
    "config",
    [
        SMALL_DETECTOR,
        DetectorConfig(),
        dataclasses.replace(SMALL_DETECTOR, point_features="none", propagation_widths=(8, 4, 2)),
    ],
    ids=["small", "default", "plain"],
)
def test_the_weights_of_a_detector(config):
    features = POINT_FEATURES[config.point_features]
    assert detector_weights(config, features) == size(Detector(config))


@pytest.mark.parametrize(
    "config",
    [
        SMALL_TRACKER,
        TrackerConfig(),
        tracker_with(fusion="none"),
        tracker_with(fusion="concat", fusion_keeps_features=False),
        tracker_with(fusion="elementwise_product"),
        tracker_with(fusion="dot_product", fusion_keeps_features=False),
        tracker_with(fused_features="filter+FC2"),
        tracker_with(fused_features="DSA3+DFP3"),
    ],
    ids=str,
)
def test_the_weights_of_a_tracker(config):
    network = TrackingNetwork(SMALL_DETECTOR, config)
    features = network.fused_features.channels(SMALL_DETECTOR)
    assert tracker_weights(config, features) == size(network)


@pytest.mark.parametrize("kind", ["detector", "tracker"])
def test_a_checkpoint_of_an_enormous_network_is_refused(tmp_path, monkeypatch, kind):
    path = write_weights(tmp_path) / f"{kind}.npz"
    meta, arrays = checkpoint.load(path)
    meta["network"]["propagation_widths"] = WIDE
    np.savez(path, meta=np.frombuffer(json.dumps(meta).encode(), np.uint8), **arrays)
    detector = None if kind == "detector" else load_detector(tmp_path / "detector.npz")
    built = []
    monkeypatch.setattr("models.layers.LinearNormReLU.__init__", lambda *_, **__: built.append(1))
    with pytest.raises(InputError, match=rf"{kind}.npz: widths of the {kind}: expected at most 89"):
        load_detector(path) if detector is None else load_tracker(path, detector)
    assert not built


@pytest.mark.parametrize("kind", ["detector", "tracker"])
def test_flags_of_an_enormous_network_are_refused(tmp_path, capsys, kind):
    data = write_sequence(write_sequence(tmp_path / "data"), 1)
    main = train_det.main if kind == "detector" else train_track.main
    words = ["--data_root", data, "--seqs", "0000", "--val_seqs", "0001"]
    words += ["--workdir", tmp_path / "work", f"--{kind}.propagation_widths", json.dumps(WIDE)]
    if kind == "tracker":
        words += ["--detector", write_weights(tmp_path) / "detector.npz"]
    assert run(main, [str(word) for word in words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"widths of the {kind}: expected at most" in error
    assert not (tmp_path / "work").exists()
