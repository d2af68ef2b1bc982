"""Stored frames give the boxes and, within float16, the displacement of the networks themselves."""

import dataclasses

import numpy as np
import pytest
from helpers import two_cars
from helpers.small_weights import write_weights

from evaluation.detections import NetworkDetections
from evaluation.scene import open_scenes
from experiments.ablation.stored_frames import StoredDetections, frame_path, store_frames
from models.config import FUSED_FEATURES
from models.inference import StreamingNetwork
from models.tracker import TrackingNetwork
from models.weights import load_networks


@pytest.mark.parametrize(
    ("missing", "fused_features"), [(None, "filter+FC1"), (1, "filter+FC1"), (None, "DSA3+DFP3")]
)
def test_stored_frames_equal_the_networks(tmp_path, missing, fused_features):
    two_cars.write_sequence(tmp_path, 0, frames=3)
    if missing is not None:
        (tmp_path / "training" / "velodyne" / "0000" / f"{missing:06d}.bin").unlink()
    detector, tracker, scorer = load_networks(write_weights(tmp_path / "weights"))
    if fused_features != tracker.config.fused_features:
        config = dataclasses.replace(tracker.config, fused_features=fused_features)
        tracker = TrackingNetwork(detector.config, config)
    network = StreamingNetwork(detector, tracker, scorer, min_score=0.0)
    scenes = open_scenes(tmp_path, [0])
    store_frames(network, scenes, tmp_path / "frames", "detector")
    first = frame_path(tmp_path / "frames", FUSED_FEATURES[-1], scenes[0], 0)
    stored = first.stat().st_mtime_ns
    store_frames(network, scenes, tmp_path / "frames", "detector")  # nothing left to do
    assert first.stat().st_mtime_ns == stored
    expected = list(NetworkDetections(network).frames(scenes[0]))
    found = list(StoredDetections(network, tmp_path / "frames").frames(scenes[0]))
    assert [f.t for f in found] == [f.t for f in expected] == [0, 1, 2]
    assert any(len(f) for f in found)
    for ours, direct in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours.boxes, direct.boxes)
        np.testing.assert_array_equal(ours.scores, direct.scores)
        assert ours.types.tolist() == direct.types.tolist()
        assert (ours.points is None) == (direct.points is None)
        if direct.points is not None:
            np.testing.assert_array_equal(ours.points, direct.points)
            np.testing.assert_allclose(ours.displacement, direct.displacement, atol=5e-3)
    if missing is None:
        assert np.abs(found[2].displacement).max() > 0
