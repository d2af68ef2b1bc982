"""The point-wise feature extractor, that is the detector (section III.1; Table I, DET).

Points -> foreground mask, boxes, point features.
"""

from typing import NamedTuple

import keras
import tensorflow as tf

from models.boxes.box_coding import head_channels, split_head
from models.config import DetectorConfig
from models.feature_propagation import (
    FeaturePropagation,
    InterpolationIndices,
    interpolation_indices,
)
from models.layers import SharedMLP
from models.local_pointnet import Points
from models.set_abstraction import (
    SetAbstraction,
    SetAbstractionIndices,
    set_abstraction_indices,
)
from models.set_upconv import SetUpconv, neighbors_within
from models.weight_count import check_detector
from tf_ops.devices import on_cpu


class DetectorInputs(NamedTuple):
    """Points of every level and all indices between them, made from coordinates alone."""

    query_xyz: tf.Tensor  # (B, Q, 3) points at which mask and boxes are predicted; all N to detect
    level_xyz: tuple[tf.Tensor, ...]  # (B, N, 3), then the points of SA1 to SA4
    abstraction: tuple[SetAbstractionIndices, ...]  # SA1 to SA4
    upconv: tuple[tf.Tensor, ...]  # FP1 to FP3: (B, M, 8) int32
    propagation: InterpolationIndices  # FP4: from the points of SA1 to query_xyz


class BoxPredictions(NamedTuple):
    """The detector's head, split once (section III.1): one prediction for each point."""

    mask_logits: tf.Tensor  # (B, Q, 2) background, foreground
    center_offset: tf.Tensor  # (B, Q, 3) metres, level frame: box centre - point
    heading_scores: tf.Tensor  # (B, Q, NH) logits
    heading_residual_normalized: tf.Tensor  # (B, Q, NH) in half bins, [-1, 1]
    size_scores: tf.Tensor  # (B, Q, NS) logits
    size_residual_normalized: tf.Tensor  # (B, Q, NS, 3) size / template - 1
    class_scores: tf.Tensor  # (B, Q, NC) logits
    quality_logits: tf.Tensor  # (B, Q, 1) predicted 3-D IoU; (B, Q, 0) if not predicted


class DetectorOutputs(NamedTuple):
    """Outputs that losses, decoding and the tracker use."""

    boxes: BoxPredictions
    fc1: tf.Tensor  # (B, Q, 128)
    fc2: tf.Tensor  # (B, Q, C) the head before it is split
    abstraction: tuple[tf.Tensor, ...]  # features of SA1 to SA4
    upconv: tuple[tf.Tensor, ...]  # features of FP1 to FP3


@on_cpu
def detector_inputs(xyz: tf.Tensor, config: DetectorConfig, query_xyz: tf.Tensor | None = None):
    """The pyramid of indices of a batch of scans.

    Args:
        xyz: (B, N, 3) float32, level frame, metres; N >= 1.
        query_xyz: (B, Q, 3) points at which to predict; None: all of xyz.

    Returns:
        DetectorInputs. Depends on coordinates alone, so the input pipeline can make it, on the
        CPU; the tensors that a GPU needs are copied there once.
    """
    levels, abstraction = [xyz], []
    for layer in config.set_abstraction:
        indices, centers = set_abstraction_indices(levels[-1], layer)
        abstraction.append(indices)
        levels.append(centers)
    upconv = [
        neighbors_within(layer.num_neighbors, layer.radius, levels[-1 - i], levels[-2 - i])
        for i, layer in enumerate(config.set_upconv)
    ]
    query_xyz = xyz if query_xyz is None else query_xyz
    propagation = interpolation_indices(query_xyz, levels[1])
    return DetectorInputs(query_xyz, tuple(levels), tuple(abstraction), tuple(upconv), propagation)


POINT_FEATURES = {"none": 0, "height": 1, "height+range": 2}


def point_features(xyz: tf.Tensor, kind: str) -> tf.Tensor | None:
    """Features (B, N, 0 to 2) of points (B, N, 3): height / 2 m, horizontal range / 50 m."""
    features = [xyz[..., 2:] / 2.0, tf.norm(xyz[..., :2], axis=-1, keepdims=True) / 50.0]
    count = POINT_FEATURES[kind]
    return tf.concat(features[:count], -1) if count else None


class Detector(keras.Model):
    """Four SA, three set upconv, one feature propagation, two fully connected layers."""

    def __init__(self, config: DetectorConfig, **kwargs):
        super().__init__(name="detector", **kwargs)
        self.config = config
        momentum, channels = config.batch_norm_momentum, POINT_FEATURES[config.point_features]
        check_detector(config, channels)
        skips = [channels]
        self.set_abstraction = []
        for i, layer in enumerate(config.set_abstraction):
            block = SetAbstraction(channels, layer, momentum, name=f"sa{i + 1}")
            self.set_abstraction.append(block)
            channels = block.channels
            skips.append(channels)
        self.set_upconv = []
        for i, layer in enumerate(config.set_upconv):
            block = SetUpconv(channels, skips[-2 - i], layer, momentum, name=f"fp{i + 1}")
            self.set_upconv.append(block)
            channels = block.channels
        self.feature_propagation = FeaturePropagation(
            channels, skips[0], config.propagation_widths, momentum, name="fp4"
        )
        channels = self.feature_propagation.channels
        self.fc1 = SharedMLP(channels, (config.fc1_width,), momentum, name="fc1")
        self.fc2 = keras.layers.Dense(head_channels(config.box), name="fc2")
        self.fc2.build((None, config.fc1_width))
        self.built = True

    def call(self, inputs: DetectorInputs, training: bool = False) -> DetectorOutputs:
        """DetectorInputs of B scans -> DetectorOutputs at the Q query points."""
        xyz, kind = inputs.level_xyz, self.config.point_features
        features = [point_features(xyz[0], kind)]
        for i, block in enumerate(self.set_abstraction):
            features.append(
                block(xyz[i], features[i], xyz[i + 1], inputs.abstraction[i], training=training)
            )
        upconv = [features[-1]]
        for i, block in enumerate(self.set_upconv):
            coarse, fine = Points(xyz[-1 - i], upconv[-1]), Points(xyz[-2 - i], features[-2 - i])
            upconv.append(block(coarse, fine, inputs.upconv[i], training=training))
        skip = point_features(inputs.query_xyz, kind)
        x = self.feature_propagation(upconv[-1], skip, inputs.propagation, training=training)
        fc1 = self.fc1(x, training=training)
        fc2 = self.fc2(fc1)
        boxes = BoxPredictions(*split_head(fc2, self.config.box))
        return DetectorOutputs(boxes, fc1, fc2, tuple(features[1:]), tuple(upconv[1:]))
