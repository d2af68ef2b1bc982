"""Boxes as heading bins, size templates and residuals (Frustum PointNets; section III.1)."""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from models.config import BoxCodingConfig
from tf_ops.shapes import sizes


class BoxTargets(NamedTuple):
    """A box per point, encoded. Undefined (zero) where the point is background."""

    center_offset: np.ndarray  # (..., 3) float32 metres, level frame: box centre - point
    heading_bin: np.ndarray  # (...) int32
    heading_residual_normalized: np.ndarray  # (...) float32 in half bins, [-1, 1]
    size_template: np.ndarray  # (...) int32
    size_residual_normalized: np.ndarray  # (..., 3) float32: size / template - 1
    semantic_class: np.ndarray  # (...) int32 index into config.classes


def head_channels(config: BoxCodingConfig) -> int:
    """C = 2 + 3 + 2 NH + 4 NS + NC (section III.1), and 1 for the predicted quality."""
    return sum(_head_sizes(config))


def _head_sizes(config: BoxCodingConfig) -> tuple[int, ...]:
    heading, size = config.num_heading_bins, len(config.size_templates)
    return (2, 3, heading, heading, size, 3 * size, len(config.classes), int(config.quality))


def split_head(head: tf.Tensor, config: BoxCodingConfig) -> list[tf.Tensor]:
    """head (B, Q, C) -> the fields of BoxPredictions, in order."""
    parts = tf.split(head, _head_sizes(config), axis=-1)
    templates = len(config.size_templates)
    parts[5] = tf.reshape(parts[5], [*sizes(head)[:-1], templates, 3])
    return parts


def encode_boxes(
    points: np.ndarray, boxes: np.ndarray, classes: np.ndarray, config: BoxCodingConfig
) -> BoxTargets:
    """Encodes the box of each point.

    Args:
        points: (P, 3) level frame, metres. boxes: (P, 7) level frame. classes: (P,) int32 index
            into config.classes, which is also the index of the size template when NS = NC,
            else the template nearest in size is taken.

    Returns:
        BoxTargets with leading shape (P,).
    """
    width = 2 * np.pi / config.num_heading_bins
    yaw = np.mod(boxes[:, 6], 2 * np.pi)
    heading_bin = np.floor(yaw / width + 0.5).astype(np.int32)  # bin i is centred on i * width
    residual = yaw - heading_bin * width
    templates = np.asarray(config.size_templates, np.float32)
    if len(templates) == len(config.classes):
        template = classes.astype(np.int32)
    else:
        distance = np.abs(np.log(boxes[:, None, 3:6] / templates[None])).sum(-1)
        template = distance.argmin(-1).astype(np.int32)
    return BoxTargets(
        (boxes[:, :3] - points).astype(np.float32),
        heading_bin % config.num_heading_bins,
        (residual / (width / 2)).astype(np.float32),
        template,
        (boxes[:, 3:6] / templates[template] - 1).astype(np.float32),
        classes.astype(np.int32),
    )


def decode_targets(points: tf.Tensor, targets: BoxTargets, config: BoxCodingConfig) -> tf.Tensor:
    """The labelled box of each point, from its encoding: points (B, Q, 3) -> (B, Q, 7)."""
    return _boxes(
        points + targets.center_offset,
        targets.heading_bin,
        targets.heading_residual_normalized,
        targets.size_template,
        targets.size_residual_normalized,
        config,
    )


def decode_boxes(points: tf.Tensor, predictions, config: BoxCodingConfig) -> tf.Tensor:
    """The box of largest heading and size score for each point.

    Args:
        points: (B, Q, 3) level frame, metres; predictions: BoxPredictions with shape (B, Q, ...).

    Returns:
        (B, Q, 7) boxes, level frame; yaw in [-pi, pi), sizes at least 0.1 m.
    """
    heading_bin = tf.argmax(predictions.heading_scores, -1, output_type=tf.int32)
    template = tf.argmax(predictions.size_scores, -1, output_type=tf.int32)
    return _boxes(
        points + predictions.center_offset,
        heading_bin,
        tf.gather(predictions.heading_residual_normalized, heading_bin, batch_dims=2),
        template,
        tf.gather(predictions.size_residual_normalized, template, batch_dims=2),
        config,
    )


def _boxes(center, heading_bin, heading_residual, template, size_residual, config) -> tf.Tensor:
    width = 2 * np.pi / config.num_heading_bins
    yaw = tf.cast(heading_bin, tf.float32) * width + heading_residual * (width / 2)
    yaw = tf.math.floormod(yaw + np.pi, 2 * np.pi) - np.pi
    size = tf.gather(tf.constant(config.size_templates, tf.float32), template) * (1 + size_residual)
    return tf.concat([center, tf.maximum(size, 0.1), yaw[..., tf.newaxis]], -1)
