"""How often a traced graph goes from the CPU to the features' device and back."""

import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER

from models.detector import Detector, detector_inputs
from models.tracker import TrackingNetwork
from tf_ops import farthest_point_sample
from tf_ops.devices import without_fused_ops

SCAN = tf.TensorSpec([1, SMALL_DETECTOR.num_points, 3], tf.float32)


def device_changes(graph: tf.Graph) -> int:
    """The most changes between pinned and free ops on a way through the graph.

    Ops pinned to the CPU stay there; all others follow the model, to a GPU where there is one.
    Constants are wherever they are needed.
    """
    changes: dict[str, int] = {}
    for op in graph.get_operations():  # in an order in which inputs come first
        before = [x.op for x in op.inputs if x.op.inputs or x.op.type == "Placeholder"]
        counts = [changes[b.name] + (_pinned(b) != _pinned(op)) for b in before]
        changes[op.name] = max(counts, default=0)
    return max(changes.values())


def _pinned(op: tf.Operation) -> bool:
    return "CPU" in op.device


def traced(function, *signature) -> tf.types.experimental.ConcreteFunction:
    """The graph as on a GPU: features go through TensorFlow's own ops."""
    with without_fused_ops():
        return tf.function(function, autograph=False).get_concrete_function(*signature)


@pytest.fixture(scope="module")
def networks():
    return Detector(SMALL_DETECTOR), TrackingNetwork(SMALL_DETECTOR, SMALL_TRACKER)


@pytest.fixture(scope="module")
def detect(networks):
    detector, tracker = networks

    def detect(xyz):
        inputs = detector_inputs(xyz, SMALL_DETECTOR)
        return tracker.fused_features(inputs, detector(inputs, training=False))

    return traced(detect, SCAN)


def test_changes_are_counted_along_the_longest_way():
    def back_and_forth(xyz):
        for _ in range(3):
            rows = farthest_point_sample(8, xyz)  # pinned
            xyz = tf.gather(xyz, rows, batch_dims=1)  # free
        return xyz, xyz + 1.0

    assert device_changes(traced(back_and_forth, SCAN).graph) == 6


def test_the_detector_makes_its_indices_in_one_block(detect):
    """From the scan to the CPU for the indices, and on to the features."""
    assert device_changes(detect.graph) == 2


def test_the_tracker_makes_its_indices_in_one_block(networks, detect):
    """From the kept points to the CPU for the indices of both frames, and on to the features."""
    tracker = networks[1]

    def associate(previous, current):
        return tracker.displacement(tracker.encode(previous), tracker.encode(current))

    frame = tf.nest.map_structure(
        lambda x: tf.TensorSpec(x.shape, x.dtype), detect.structured_outputs
    )
    assert device_changes(traced(associate, frame, frame).graph) == 2
