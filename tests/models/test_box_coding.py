"""Box code -> decode is the identity; the head's channels are split as the paper counts them."""

import numpy as np
import tensorflow as tf
from hypothesis import given, settings
from hypothesis import strategies as st

from models.boxes.box_coding import (
    decode_boxes,
    decode_targets,
    encode_boxes,
    head_channels,
    split_head,
)
from models.config import BoxCodingConfig
from models.detector import BoxPredictions

CONFIG = BoxCodingConfig()


def predictions_of(targets, config=CONFIG):
    """Predictions equal to the targets, at one frame of P points."""
    count = len(targets.heading_bin)
    nh, ns, nc = config.num_heading_bins, len(config.size_templates), len(config.classes)
    rows = np.arange(count)
    residual = np.zeros((count, nh), np.float32)
    residual[rows, targets.heading_bin] = targets.heading_residual_normalized
    size = np.zeros((count, ns, 3), np.float32)
    size[rows, targets.size_template] = targets.size_residual_normalized
    fields = [
        np.zeros((count, 2)),
        targets.center_offset,
        np.eye(nh)[targets.heading_bin],
        residual,
        np.eye(ns)[targets.size_template],
        size,
        np.eye(nc)[targets.semantic_class],
        np.zeros((count, 1)),
    ]
    return BoxPredictions(*(tf.constant(f[None], tf.float32) for f in fields))


@settings(max_examples=60, deadline=None)
@given(
    yaw=st.floats(-np.pi, np.pi, exclude_max=True),
    size=st.floats(0.5, 2.0),
    center=st.tuples(*[st.floats(-60, 60)] * 3),
    label=st.integers(0, 1),
)
def test_code_then_decode_is_the_identity(yaw, size, center, label):
    length, width, height = (size * v for v in CONFIG.size_templates[label])
    box = np.array([[*center, length, width, height, yaw]])
    point = np.array([[center[0] + 1.0, center[1] - 0.5, center[2]]], np.float32)
    targets = encode_boxes(point, box, np.array([label]), CONFIG)
    assert -1 - 1e-5 <= targets.heading_residual_normalized[0] <= 1 + 1e-5
    decoded = decode_boxes(tf.constant(point[None]), predictions_of(targets), CONFIG).numpy()[0, 0]
    np.testing.assert_allclose(decoded[:6], box[0, :6], atol=1e-4)
    batched = type(targets)(*(tf.constant(field[None]) for field in targets))
    np.testing.assert_allclose(
        decode_targets(tf.constant(point[None]), batched, CONFIG)[0, 0], decoded, atol=1e-5
    )
    turn = np.angle(np.exp(1j * (decoded[6] - yaw)))
    assert abs(turn) < 1e-5
    assert -np.pi <= decoded[6] < np.pi + 1e-6


def test_head_has_the_papers_channels():
    nh, ns, nc = 12, 2, 2
    assert head_channels(CONFIG) == 2 + 3 + 2 * nh + 4 * ns + nc + 1  # and the quality
    paper = BoxCodingConfig(quality=False)
    assert head_channels(paper) == 2 + 3 + 2 * nh + 4 * ns + nc


def test_split_takes_every_channel_once():
    head = tf.range(head_channels(CONFIG), dtype=tf.float32)[None, None]
    parts = split_head(head, CONFIG)
    joined = np.concatenate([np.ravel(part) for part in parts])
    np.testing.assert_array_equal(joined, np.arange(head_channels(CONFIG)))
    assert parts[5].shape == (1, 1, len(CONFIG.size_templates), 3)


def test_more_templates_than_classes_take_the_nearest_in_size():
    config = BoxCodingConfig(size_templates=((4.0, 1.6, 1.5), (5.0, 1.9, 2.2), (8.0, 2.5, 3.0)))
    box = np.array([[0, 0, 0, 7.5, 2.4, 2.9, 0.0]])
    targets = encode_boxes(np.zeros((1, 3), np.float32), box, np.array([0]), config)
    assert targets.size_template[0] == 2
    assert targets.semantic_class[0] == 0
