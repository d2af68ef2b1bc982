"""The choice of the decoding's parameters: counting by hand, and the script from end to end."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import tensorflow as tf
from helpers import two_cars
from helpers.network_cases import SMALL_DETECTOR
from helpers.small_weights import write_weights

from models.boxes.box_decoding import Detections
from models.config import DecodingConfig
from models.detector import BoxPredictions
from studies import decoding_parameters as module

CAR = np.array([10.0, 0, 0, 4, 2, 1.5, 0])


def moved(*x: float) -> np.ndarray:
    return np.array([CAR + np.array([value, *[0] * 6]) for value in x]).reshape(-1, 7)


def test_a_true_box_is_hit_once():
    """Boxes come best first: the second on the same car is false, and so is one in the void."""
    hits = module._hits(moved(0, 20), moved(0.2, 0.4, 20.0, 50.0))
    assert hits.tolist() == [True, False, True, False]
    assert module._hits(moved(), moved(0)).tolist() == [False]


def test_the_least_score_is_swept(monkeypatch):
    """Two cars; found with 0.9 and 0.6, two false boxes with 0.5 and 0.1: best from 0.525 on."""
    boxes, scores = moved(0.1, 20.1, 40, 50), np.array([0.9, 0.6, 0.5, 0.1])
    found = [Detections(boxes, scores, np.zeros(4, int))]
    monkeypatch.setattr(module, "decode_detections", lambda *_: found)
    frame = module.Frame(np.zeros((1, 0, 3)), None, moved(0, 20))
    best = module.score([frame], None, DecodingConfig())
    assert best["accuracy"] == best["recall"] == best["precision"] == 1.0
    assert best["min_score"] == pytest.approx(0.525)


def test_the_detector_gets_as_many_points_as_in_tracking(monkeypatch):
    """Up to 4/3 of N = 128; of a smaller scan all points, repeated up to N."""
    counts = []

    def detect(xyz):
        counts.append(xyz.shape[1])
        return BoxPredictions(*[tf.zeros((1, xyz.shape[1], 2))] * len(BoxPredictions._fields))

    detector = SimpleNamespace(config=SMALL_DETECTOR)
    for count in (100, 150, 400):
        module.predict(detector, detect, np.ones((count, 4)), moved(), np.random.default_rng(0))
    assert counts == [128, 150, 170]


def test_from_end_to_end(tmp_path, monkeypatch, capsys):
    root = two_cars.write_sequence(tmp_path / "data", frames=3)
    weights = write_weights(tmp_path / "weights") / "detector.npz"
    monkeypatch.setattr(module, "TRIALS", {"min_probability": (0.4, 0.5), "score_prior": (2.0,)})
    words = ["--data_root", root, "--seqs", "0000", "--every", "2", "--displacement", "1"]
    module.main([str(w) for w in (*words, "--weights", weights, "--out", tmp_path / "out")])
    record = json.loads((tmp_path / "out" / "decoding_parameters.json").read_text())
    assert [row["value"] for row in record["figures"]] == [0.4, 0.5, 2.0]
    assert all(0 <= row["recall"] <= 1 and row["accuracy"] <= 1 for row in record["figures"])
    assert "| min_probability | 0.4 * |" in " ".join(capsys.readouterr().out.split())
