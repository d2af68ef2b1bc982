"""The two graphs as a whole: shapes, parameters, gradients, symmetries, unusual clouds."""

import dataclasses

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import (
    SMALL_DETECTOR,
    SMALL_TRACKER,
    cloud,
    randomize_norms,
    tracker_with,
)

from common.errors import InputError
from models.boxes.box_coding import head_channels
from models.config import DetectorConfig, SetUpconvConfig, TrackerConfig
from models.detector import Detector, detector_inputs
from models.tracker import TrackingNetwork
from training.tracker_task import other_frames

FUSIONS = ("elementwise_product", "concat", "cosine_distance", "dot_product")
FEATURES = ("DSA2+DFP2", "DSA3+DFP3", "filter+FC2", "filter+FC1")


def parameters(model) -> int:
    return sum(int(np.prod(v.shape)) for v in model.trainable_variables)


def run(config=SMALL_DETECTOR, xyz=None, training=False, seed=0):
    tf.keras.utils.set_random_seed(seed)
    detector = Detector(config)
    randomize_norms(detector)
    inputs = detector_inputs(cloud(2, config.num_points) if xyz is None else xyz, config)
    return detector, inputs, detector(inputs, training=training)


def small_tracker(config, detector):
    tf.keras.utils.set_random_seed(1)
    return TrackingNetwork(detector.config, config)


def test_parameter_counts():
    assert parameters(Detector(DetectorConfig())) == 1_002_887 + 129  # the quality's channel
    paper = dataclasses.replace(DetectorConfig().box, quality=False)
    assert parameters(Detector(DetectorConfig(box=paper))) == 1_002_887
    assert parameters(TrackingNetwork(DetectorConfig(), TrackerConfig())) == 655_139


def test_table_1():
    detector, tracker = DetectorConfig(), TrackerConfig()
    rows = [(layer.num_points, layer.radius, layer.widths) for layer in detector.set_abstraction]
    assert rows == [
        (2048, 1.0, (32, 32, 64)),
        (512, 2.0, (64, 64, 128)),
        (128, 4.0, (128, 128, 256)),
        (32, 8.0, (256, 256, 512)),
    ]
    rows = [(layer.radius, layer.widths) for layer in detector.set_upconv]
    assert rows == [(8.0, (256, 256)), (4.0, (128, 128, 256)), (2.0, (128, 128, 256))]
    assert (detector.propagation_widths, detector.fc1_width) == ((256, 256), 128)
    rows = [(layer.num_points, layer.radius, layer.widths) for layer in tracker.set_abstraction]
    assert rows == [(2048, 0.5, (32, 32, 64)), (512, 1.0, (64, 64, 128))]
    assert (tracker.association_radius, tracker.association_widths) == (5.0, (128, 128))
    sa3 = tracker.refinement_abstraction
    assert (sa3.num_points, sa3.radius, sa3.widths) == (32, 4.0, (256, 256))
    rows = [(layer.radius, layer.widths) for layer in tracker.refinement_upconv]
    assert rows == [(4.0, (256, 256)), (1.0, (128, 256, 256))]
    assert (tracker.propagation_widths, tracker.fc1_width) == ((256, 256), 128)
    # section IV.B: N, N', K
    assert (detector.num_points, tracker.num_kept_points) == (15000, 5000)
    assert tracker.association_neighbors == 64


def test_detector_shapes():
    _, _, outputs = run()
    count, boxes = SMALL_DETECTOR.num_points, outputs.boxes
    assert boxes.mask_logits.shape == (2, count, 2)
    assert boxes.center_offset.shape == (2, count, 3)
    assert boxes.heading_scores.shape == boxes.heading_residual_normalized.shape == (2, count, 12)
    assert boxes.size_residual_normalized.shape == (2, count, 2, 3)
    assert outputs.fc1.shape == (2, count, 16)
    assert outputs.fc2.shape == (2, count, head_channels(SMALL_DETECTOR.box))


def test_outputs_at_some_query_points_equal_those_at_all():
    detector, _, everywhere = run()
    xyz = cloud(2, SMALL_DETECTOR.num_points)
    inputs = detector_inputs(xyz, SMALL_DETECTOR, xyz[:, 10:30])
    some = detector(inputs, training=False)
    np.testing.assert_allclose(some.fc2, everywhere.fc2[:, 10:30], rtol=1e-4, atol=1e-5)


def test_gradients_reach_every_variable_of_the_detector():
    detector = Detector(SMALL_DETECTOR)
    inputs = detector_inputs(cloud(2, 128), SMALL_DETECTOR)
    with tf.GradientTape() as tape:
        loss = tf.reduce_sum(tf.square(detector(inputs, training=True).fc2))
    for variable, gradient in zip(
        detector.trainable_variables, tape.gradient(loss, detector.trainable_variables), strict=True
    ):
        assert gradient is not None, variable.path
        assert float(tf.norm(gradient)) > 0, variable.path


@pytest.mark.parametrize("keeps", [True, False])
@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("features", FEATURES)
def test_gradients_reach_every_variable_of_every_tracker(fusion, features, keeps):
    if features != "filter+FC1" and not keeps:
        pytest.skip("fusion and features are independent; one feature choice is enough here")
    config = tracker_with(fusion=fusion, fused_features=features, fusion_keeps_features=keeps)
    detector, inputs, outputs = run(xyz=cloud(2, 128, extent=1.0))  # dense: no isolated points
    tracker = small_tracker(config, detector)
    frame = tracker.fused_features(inputs, outputs)
    moved = frame._replace(xyz=frame.xyz + 0.3)
    with tf.GradientTape() as tape:
        displacement = tracker(frame, moved, training=True)
        loss = tf.reduce_sum(tf.square(displacement - 1.0))
    assert displacement.shape == (2, frame.rows.shape[1], 3)
    np.testing.assert_array_equal(frame.xyz, tf.gather(inputs.query_xyz, frame.rows, batch_dims=1))
    gradients = tape.gradient(loss, tracker.trainable_variables)
    for variable, gradient in zip(tracker.trainable_variables, gradients, strict=True):
        assert gradient is not None, variable.path
        assert float(tf.norm(gradient)) > 0, variable.path


def test_moving_the_scene_changes_nothing_without_absolute_features():
    config = dataclasses.replace(SMALL_DETECTOR, point_features="none")
    xyz = np.round(cloud(1, 128) * 64) / 64  # exact in float32, also when moved
    detector, _, here = run(config, xyz)
    there = detector(detector_inputs(xyz + np.float32([16, -8, 2]), config), training=False)
    np.testing.assert_allclose(there.fc2, here.fc2, rtol=1e-3, atol=1e-3)


def test_permuting_the_points_permutes_the_outputs():
    """Sampling starts at the first point, and no ball here holds more than its places."""
    xyz = cloud(1, 60, extent=20.0)
    layers = tuple(
        dataclasses.replace(layer, num_neighbors=64) for layer in SMALL_DETECTOR.set_abstraction
    )
    config = dataclasses.replace(SMALL_DETECTOR, set_abstraction=layers)
    detector, _, before = run(config, xyz)
    order = np.concatenate([[0], 1 + np.random.default_rng(3).permutation(59)])
    after = detector(detector_inputs(xyz[:, order], config), training=False)
    np.testing.assert_allclose(after.fc2, before.fc2.numpy()[:, order], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("count", [1, 2, 5, 63])
def test_fewer_points_than_the_layers_sample(count):
    detector, inputs, outputs = run(xyz=cloud(1, count))
    assert outputs.fc2.shape[1] == count
    tracker = small_tracker(SMALL_TRACKER, detector)
    frame = tracker.fused_features(inputs, outputs)
    displacement = tracker(frame, frame, training=False)
    assert np.isfinite(outputs.fc2).all()
    assert np.isfinite(displacement).all()


def test_identical_points():
    detector, inputs, outputs = run(xyz=np.ones((2, 128, 3), "f4"), training=True)
    tracker = small_tracker(SMALL_TRACKER, detector)
    frame = tracker.fused_features(inputs, outputs)
    displacement = tracker(frame, frame, training=True)
    assert np.isfinite(outputs.fc2).all()
    assert np.isfinite(displacement).all()


def tracker_and_pair():
    detector, inputs, outputs = run()
    tracker = small_tracker(SMALL_TRACKER, detector)
    randomize_norms(tracker)
    first = tracker.fused_features(inputs, outputs)
    second = first._replace(xyz=first.xyz + 0.2)
    return tracker, first, second


def test_encoding_once_equals_encoding_the_pair():
    tracker, first, second = tracker_and_pair()
    streamed = tracker.displacement(tracker.encode(first), tracker.encode(second))
    np.testing.assert_allclose(tracker(first, second), streamed, rtol=1e-4, atol=1e-5)


def test_both_ways_are_the_pair_and_the_pair_backwards():
    tracker, first, second = tracker_and_pair()
    both = tf.nest.map_structure(lambda a, b: tf.concat([a, b], 0), first, second)
    expected = tf.concat([tracker(first, second), tracker(second, first)], 0)
    encoded = tracker.encode(both)
    found = tracker.displacement(encoded, other_frames(encoded))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
    points = tf.gather(both.xyz, encoded.indices.kept_rows, batch_dims=1)
    np.testing.assert_array_equal(points, encoded.level2.xyz)


def test_any_batch_size_in_one_graph():
    detector = Detector(SMALL_DETECTOR)

    @tf.function(input_signature=[tf.TensorSpec([None, None, 3])], jit_compile=False)
    def graph(xyz):
        return detector(detector_inputs(xyz, SMALL_DETECTOR), training=False).fc2

    for batch, count in ((1, 128), (3, 128), (2, 77)):
        assert graph(cloud(batch, count)).shape[:2] == (batch, count)


def test_a_set_upconv_layer_has_two_widths():
    with pytest.raises(InputError, match="expected two or more widths of a layer, found 128"):
        SetUpconvConfig(radius=1.0, widths=(128,))
