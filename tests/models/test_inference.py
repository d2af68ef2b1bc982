"""The networks on a stream: empty frames, one point, repeatable sampling."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER, cloud

from models.boxes.box_score import BoxScorer
from models.detector import Detector, detector_inputs
from models.inference import StreamingNetwork
from models.tracker import TrackingNetwork


@pytest.fixture(scope="module")
def network():
    tf.keras.utils.set_random_seed(0)
    detector = Detector(SMALL_DETECTOR)
    return StreamingNetwork(detector, TrackingNetwork(SMALL_DETECTOR, SMALL_TRACKER))


def test_a_stream_equals_the_two_graphs(network):
    scans = [cloud(1, 300, seed)[0] for seed in (1, 2)]
    states = [network.detect(scan, t) for t, scan in enumerate(scans)]
    found = network.displacement(*states)
    frames = []
    for t, scan in enumerate(scans):
        inputs = detector_inputs(network.sample(scan, t), SMALL_DETECTOR)
        outputs = network.detector(inputs, training=False)
        frames.append(network.tracker.fused_features(inputs, outputs))
    np.testing.assert_allclose(states[0].points, frames[0].xyz[0], atol=1e-6)
    expected = network.tracker(*frames, training=False)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


def test_sampling_depends_on_the_frame_alone(network):
    scan = cloud(1, 300)[0]
    np.testing.assert_array_equal(network.sample(scan, 3), network.sample(scan, 3))
    assert not np.array_equal(network.sample(scan, 3), network.sample(scan, 4))


def test_all_points_of_a_scan_enter_up_to_four_thirds_of_n(network):
    n = SMALL_DETECTOR.num_points
    most = n * 4 // 3
    counts = {
        count: network.sample(cloud(1, count)[0], 0).shape[1] for count in (n - 9, n + 9, 2 * n)
    }
    assert counts == {n - 9: n, n + 9: n + 9, 2 * n: most}
    scan = cloud(1, n + 9)[0]
    assert len(np.unique(network.sample(scan, 0)[0], axis=0)) == len(np.unique(scan, axis=0))
    state = network.detect(scan, 0)
    assert state.sampled.shape == (n + 9, 3) and state.probability.shape == (n + 9,)


def test_an_empty_frame(network):
    empty = network.detect(np.zeros((0, 3)), 0)
    assert empty.detections.boxes.shape == (0, 7)
    full = network.detect(cloud(1, 300)[0], 1)
    assert network.displacement(empty, full).shape == (0, 3)
    np.testing.assert_array_equal(network.displacement(full, empty), np.zeros((48, 3)))


@pytest.mark.parametrize("count", [1, 5])
def test_few_points(network, count):
    state = network.detect(cloud(1, count)[0], 0)
    assert np.isfinite(network.displacement(state, state)).all()


def test_bad_points_are_refused(network):
    with pytest.raises(ValueError, match=r"expected points of shape \(n, >=3\)"):
        network.detect(np.zeros((5, 2)))
    with pytest.raises(ValueError, match="expected finite points"):
        network.detect(np.full((5, 3), np.nan))


def test_boxes_are_scored_by_the_scorer_and_cut_at_its_threshold(network):
    """A scorer of one feature; its threshold is the default; min_score overrides it."""
    names = ("agreement",), (-3.0,), (1.0,), (2.0,)
    scorer = BoxScorer("", 0.6, 0.0, *names)
    networks = network.detector, network.tracker, scorer
    scan = cloud(1, 300)[0]
    everything = StreamingNetwork(*networks, min_score=0.0).detect(scan).detections
    default = StreamingNetwork(*networks).detect(scan).detections
    plain = StreamingNetwork(*networks[:2], min_score=0.0).detect(scan).detections
    logit = 2 * (np.log(plain.scores / (1 - plain.scores)) + 3)
    within = (plain.scores > 0.01) & (plain.scores < 0.99)
    expected = np.sort(1 / (1 + np.exp(-logit[within])))[::-1]
    np.testing.assert_allclose(everything.scores[: within.sum()], expected, rtol=1e-3)
    assert within.any() and len(everything.scores) == len(plain.scores)
    assert len(default.scores) == np.count_nonzero(everything.scores >= 0.6)
    assert StreamingNetwork(*networks).min_score == 0.6
    assert StreamingNetwork(*networks, min_score=0.2).min_score == 0.2
