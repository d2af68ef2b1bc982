"""The plain detector is the same network; Table II's arithmetic; metrics of the networks."""

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, cloud, randomize_norms

from evaluation.scene import Scene as SceneOnDisk
from experiments.evaluate_networks import box_counts, end_point_errors
from experiments.evaluate_networks import table as networks_table
from experiments.table2 import PAPER, table
from experiments.timing.costs import detector_costs, total
from experiments.timing.plain_detector import PlainDetector
from kitti.objects import Objects
from models.boxes.box_coding import head_channels
from models.detector import Detector, detector_inputs
from tracking import FrameDetections


def layer_pairs(detector: Detector, plain: PlainDetector) -> list:
    """(LinearNormReLU of the detector, Dense, BatchNormalization) of every layer but FC2."""
    pairs = []

    def chain(layers, plain_layers):
        for i, layer in enumerate(layers):
            pairs.append((layer, *plain_layers[3 * i : 3 * i + 2]))

    for block, layers in zip(detector.set_abstraction, plain.abstraction, strict=True):
        chain([block.local.first, *block.local.rest.layers], layers)
    for block, layers, last in zip(detector.set_upconv, plain.pooling, plain.last, strict=True):
        chain([block.local.first, *block.local.rest.layers], layers)
        chain([block.last], last)
    propagation = detector.feature_propagation
    chain([propagation.first, *propagation.rest.layers], plain.propagation)
    chain(detector.fc1.layers, plain.fc1)
    return pairs


def copy_weights(detector: Detector, plain: PlainDetector) -> None:
    for layer, dense, norm in layer_pairs(detector, plain):
        dense.kernel.assign(tf.concat([kernel.value for kernel in layer.kernels.values()], 0))
        for name in ("gamma", "beta", "moving_mean", "moving_variance"):
            getattr(norm, name).assign(getattr(layer.norm, name).value)
    plain.fc2.set_weights(detector.fc2.get_weights())


@pytest.mark.parametrize("training", [True, False])
def test_the_plain_detector_is_the_same_network(training):
    """The same outputs and gradients from the same weights."""
    tf.keras.utils.set_random_seed(2)  # no value so near a ReLU's kink that rounding decides
    detector, plain = Detector(SMALL_DETECTOR), PlainDetector(SMALL_DETECTOR)
    randomize_norms(detector)
    inputs = detector_inputs(cloud(2, 128), SMALL_DETECTOR)
    plain(inputs)  # makes its variables
    copy_weights(detector, plain)
    weights = tf.random.normal([2, 128, head_channels(SMALL_DETECTOR.box)], seed=1)
    with tf.GradientTape(persistent=True) as tape:
        head, plain_head = detector(inputs, training=training).fc2, plain(inputs, training=training)
        losses = tf.reduce_sum(weights * head), tf.reduce_sum(weights * plain_head)
    np.testing.assert_allclose(plain_head, head, rtol=1e-3, atol=1e-4)
    for layer, dense, norm in layer_pairs(detector, plain):
        kernels = [kernel.value for kernel in layer.kernels.values()]
        pairs = [
            (tf.concat(tape.gradient(losses[0], kernels), 0), dense.kernel),
            (tape.gradient(losses[0], layer.norm.gamma.value), norm.gamma),
            (tape.gradient(losses[0], layer.norm.beta.value), norm.beta),
        ]
        for expected, variable in pairs:
            size = float(tf.reduce_max(tf.abs(expected)))
            assert size > 0, layer.path
            found = tape.gradient(losses[1], variable.value)
            np.testing.assert_allclose(found / size, expected / size, atol=1e-4, err_msg=layer.path)


def test_floating_point_operations_by_hand():
    head = head_channels(SMALL_DETECTOR.box)
    abstraction = (
        64 * 8 * (5 * 8 + 8 * 16)
        + 32 * 8 * (19 * 16 + 16 * 16)
        + 16 * 8 * (19 * 16 + 16 * 32)
        + 8 * 8 * (35 * 32 + 32 * 32)
    )
    upconv = (
        16 * 4 * 35 * 32
        + 16 * (32 + 32) * 32
        + 32 * 4 * 35 * 16
        + 32 * (16 + 16) * 32
        + 64 * 4 * 35 * 16
        + 64 * (16 + 16) * 32
    )
    points = 128 * (34 * 32 + 32 * 32 + 32 * 16 + 16 * head)
    assert total(detector_costs(SMALL_DETECTOR)).flops == 2.0 * (abstraction + upconv + points)


def test_table_2_shows_the_papers_figures():
    rates = [{"cores": 1, "workers": 0, "detector samples": 90.0, "tracker pairs": 40.26}]
    text = table({"ours forward": 0.1}, rates, dict.fromkeys(PAPER, 0.2), "device: CPU, 2 cores")
    assert "90.0 |" in text and "40.3 |" in text
    text = " ".join(text.split())
    assert "| 15000 | 5000 | 0.200 | 0.099 |" in text
    assert "| ours forward | 0.100 |" in text


class Scene(SceneOnDisk):
    """One object over two frames, 60 points in it, 800 on the ground around and below it."""

    boxes = np.array([[10.0, 0, 0, 4, 2, 1.5, 0], [11.0, 0, 0, 4, 2, 1.5, 0]])
    objects = Objects.from_boxes(np.arange(2), np.zeros(2, int), boxes)

    def __init__(self):
        """Nothing is on disk."""

    def points(self, t):
        rng = np.random.default_rng(t)
        inside = self.boxes[t, :3] + rng.uniform(-0.5, 0.5, (60, 3))
        return np.concatenate([inside, rng.uniform((0, -10, -0.75), (20, 10, -0.74), (800, 3))])


class Predicted:
    """Finds the object in frame 1 alone, with a false box, and moves its points by 0.9 m.

    The ground does not move, as it is trained to do.
    """

    def frames(self, scene):
        yield FrameDetections(0, np.zeros((0, 7)), np.zeros(0))
        boxes = np.concatenate([scene.boxes[1:] + 0.1, scene.boxes[1:] + 20])
        points = scene.points(0)
        moved = np.zeros_like(points)
        moved[:60, 0] = 0.9
        yield FrameDetections(1, boxes, [0.9, 0.2], points=points, displacement=moved)


def test_boxes_are_counted_one_to_one():
    counts = box_counts(Scene(), Predicted(), min_score=0.0)
    assert (counts["boxes"], counts["boxes_50"], counts["found"]) == (2, 2, 2)
    assert counts["hits@0.5"] == counts["hits_50@0.25"] == 1
    assert box_counts(Scene(), Predicted(), min_score=0.5)["found"] == 1


def test_end_point_error_of_the_foreground_points():
    errors = end_point_errors(Scene(), Predicted())
    assert len(errors) == 60
    assert errors == pytest.approx(np.full(60, 0.1))


def test_the_networks_table_shows_the_spread_over_seeds():
    columns = {
        0.0: [{"MOTA": 0.9, "recall": None}],
        2.0: [{"MOTA": m, "recall": 1} for m in (1, 2, 3)],
    }
    lines = [" ".join(line.split()) for line in networks_table(columns).splitlines()]
    assert lines[2:4] == ["| MOTA | 0.900 | 2.000 ± 1.000 |", "| recall | - | 1.000 ± 0.000 |"]
    assert "Mean ± standard deviation over 3 seeds of the object shift." in lines
