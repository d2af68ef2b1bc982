"""Both networks as a whole against the plain reference: outputs and every gradient."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, cloud, randomize_norms, tracker_with
from helpers.plain_networks import detector_head, tracker_displacement

from models.checkpoint import named_variables
from models.detector import Detector, detector_inputs
from models.layers import fold_batch_norm
from models.tracker import TrackerInputs, TrackingNetwork


def assert_same_gradients(network, losses):
    """Equal loss and equal gradients for every trainable variable, by name."""
    variables = {n: v for n, v in named_variables(network).items() if v.trainable}
    results = []
    for loss in losses:
        with tf.GradientTape() as tape:
            value = loss()
        results.append((value, tape.gradient(value, list(variables.values()))))
    (value, found), (expected_value, expected) = results
    np.testing.assert_allclose(value, expected_value, rtol=1e-4)
    for name, one, other in zip(variables, found, expected, strict=True):
        size = float(tf.reduce_max(tf.abs(other)))
        assert size > 0, name
        np.testing.assert_allclose(one / size, other / size, atol=2e-3, err_msg=name)


def test_the_detector():
    tf.keras.utils.set_random_seed(1)  # no value so near a ReLU's kink that rounding decides
    detector = Detector(SMALL_DETECTOR)
    randomize_norms(detector)
    inputs = detector_inputs(cloud(2, 128), SMALL_DETECTOR)
    weights = tf.random.normal([2, 128, detector.fc2.kernel.shape[1]], seed=1)
    found, expected = detector(inputs), detector_head(detector, inputs, False)
    np.testing.assert_allclose(found.fc2, expected[0], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(found.fc1, expected[1], rtol=1e-3, atol=1e-4)
    for training in (True, False):
        assert_same_gradients(
            detector,
            (
                lambda t=training: tf.reduce_sum(weights * detector(inputs, training=t).fc2),
                lambda t=training: tf.reduce_sum(weights * detector_head(detector, inputs, t)[0]),
            ),
        )
    fold_batch_norm(detector)
    np.testing.assert_allclose(
        detector(inputs).fc2, detector_head(detector, inputs, False)[0], rtol=1e-3, atol=1e-4
    )


@pytest.mark.parametrize(
    "fusion", ["elementwise_product", "concat", "cosine_distance", "dot_product"]
)
def test_the_tracker(fusion):
    tf.keras.utils.set_random_seed(0)
    network = TrackingNetwork(SMALL_DETECTOR, tracker_with(fusion=fusion))
    randomize_norms(network)
    rng = np.random.default_rng(0)
    frames = [
        TrackerInputs(
            np.zeros((2, 48), np.int32),
            tf.constant(cloud(2, 48, seed, extent=1.0)),
            tf.constant(rng.uniform(0, 1, (2, 48, 16)), tf.float32),
        )
        for seed in (1, 2)
    ]
    weights = tf.random.normal([2, 48, 3], seed=1)
    np.testing.assert_allclose(
        network(*frames), tracker_displacement(network, *frames, False), rtol=1e-3, atol=1e-4
    )
    for training in (True, False):
        assert_same_gradients(
            network,
            (
                lambda t=training: tf.reduce_sum(weights * network(*frames, training=t)),
                lambda t=training: tf.reduce_sum(
                    weights * tracker_displacement(network, *frames, t)
                ),
            ),
        )
    fold_batch_norm(network)
    np.testing.assert_allclose(
        network(*frames), tracker_displacement(network, *frames, False), rtol=1e-3, atol=1e-4
    )
