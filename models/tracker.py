"""The tracker graph (Table I, TRA): features of two frames -> association displacement."""

from __future__ import annotations

from typing import NamedTuple

import keras
import tensorflow as tf

from models.association_head import AssociationHead
from models.config import DetectorConfig, TrackerConfig
from models.detector import DetectorInputs, DetectorOutputs
from models.feature_propagation import FeaturePropagation, interpolation_indices
from models.linear_norm import SharedMLP
from models.probability_filter import keep, probability_filter
from models.set_abstraction import SetAbstraction, set_abstraction_indices
from models.set_upconv import SetUpconv, neighbors_within
from tf_ops import three_interpolate


class TrackerInputs(NamedTuple):
    """The detector's points and features of one frame that enter the tracker (Table IV)."""

    xyz: tf.Tensor  # (B, N', 3) metres, level frame
    features: tf.Tensor  # (B, N', C)


class EncodedFrame(NamedTuple):
    """One frame after TSA1 and TSA2; on a stream it serves two pairs."""

    xyz: tuple[tf.Tensor, tf.Tensor, tf.Tensor]  # kept points, TSA1, TSA2
    features: tuple[tf.Tensor, tf.Tensor]  # TSA1 (B, 2048, 64), TSA2 (B, 512, 128)
    rows: tf.Tensor  # (B, 512) int32, the points of TSA2 among those kept


def halves(encoded: EncodedFrame) -> tuple[EncodedFrame, EncodedFrame]:
    """B frames t-1 and then their B frames t, as one batch -> the two, apart."""
    pairs = tf.shape(encoded.rows)[0] // 2
    return (
        tf.nest.map_structure(lambda x: x[:pairs], encoded),
        tf.nest.map_structure(lambda x: x[pairs:], encoded),
    )


def swapped(encoded: EncodedFrame) -> EncodedFrame:
    """B frames t-1 and then their B frames t, as one batch: the two halves change places."""
    return tf.nest.map_structure(lambda x: tf.roll(x, tf.shape(x)[0] // 2, 0), encoded)


def kept_rows(inputs: DetectorInputs, outputs: DetectorOutputs, config: TrackerConfig):
    """Rows (B, N') int32 of level 0 that enter the tracker; the detector was asked at level 0.

    filter+...: the N' points that the probability filter keeps. DSA2+DFP2, DSA3+DFP3: the points
    of the set upconv layer (those of SA2 and of SA1).
    """
    if config.fused_features.startswith("filter"):
        return probability_filter(outputs.boxes.mask_logits, config.num_kept_points)
    rows = inputs.abstraction[0].sampled
    if config.fused_features == "DSA2+DFP2":
        rows = tf.gather(rows, inputs.abstraction[1].sampled, batch_dims=1)
    return rows


def tracker_inputs(inputs: DetectorInputs, outputs: DetectorOutputs, config: TrackerConfig):
    """The points and features that the rows of Table IV fuse.

    DSAi+DFPi: the features of the set upconv layer beside those of the abstraction layer, which
    are interpolated where their points differ (DSA3 has 128 points, DFP3 2048).
    """
    if config.fused_features.startswith("filter"):
        rows = kept_rows(inputs, outputs, config)
        features = outputs.fc1 if config.fused_features == "filter+FC1" else outputs.fc2
        return TrackerInputs(*keep(rows, inputs.query_xyz, features))
    layer = 2 if config.fused_features == "DSA2+DFP2" else 3
    abstraction, upconv = outputs.abstraction[layer - 1], outputs.upconv[layer - 1]
    xyz = inputs.level_xyz[4 - layer]
    if layer == 3:
        indices = interpolation_indices(xyz, inputs.level_xyz[layer])
        abstraction = three_interpolate(abstraction, indices.neighbors, indices.weights)
    return TrackerInputs(xyz, tf.concat([abstraction, upconv], -1))


def tracker_channels(config: TrackerConfig, detector: DetectorConfig, head_channels: int) -> int:
    """Channels of TrackerInputs.features."""
    if config.fused_features == "filter+FC1":
        return detector.fc1_width
    if config.fused_features == "filter+FC2":
        return head_channels
    level = 2 if config.fused_features == "DSA2+DFP2" else 3
    widths = detector.set_abstraction[level - 1].widths
    return sum(w[-1] for w in widths) + detector.set_upconv[level - 1].widths[-1]


class Tracker(keras.Model):
    """Association module (SA1, SA2, head) and refinement module (SA3, FP1 to FP3, FC1, FC2)."""

    def __init__(self, channels: int, config: TrackerConfig, **kwargs):
        super().__init__(name="tracker", **kwargs)
        self.config, self.in_channels = config, channels
        momentum = config.batch_norm_momentum
        sa1, sa2 = config.set_abstraction
        fp1, fp2 = config.refinement_upconv
        self.sa1 = SetAbstraction(channels, sa1, momentum, name="sa1")
        self.sa2 = SetAbstraction(self.sa1.channels, sa2, momentum, name="sa2")
        self.association = AssociationHead(
            self.sa2.channels,
            config.fusion,
            config.fusion_keeps_features,
            config.association_radius,
            config.association_neighbors,
            config.association_widths,
            momentum,
            name="association",
        )
        channels = self.association.channels
        self.sa3 = SetAbstraction(channels, config.refinement_abstraction, momentum, name="sa3")
        self.fp1 = SetUpconv(self.sa3.channels, channels, fp1, momentum, name="fp1")
        self.fp2 = SetUpconv(self.fp1.channels, self.sa1.channels, fp2, momentum, name="fp2")
        self.fp3 = FeaturePropagation(
            self.fp2.channels, 0, config.propagation_widths, momentum, name="fp3"
        )
        self.fc1 = SharedMLP(self.fp3.channels, (config.fc1_width,), momentum, name="fc1")
        self.fc2 = keras.layers.Dense(3, name="fc2")
        self.fc2.build((None, config.fc1_width))
        self.built = True

    def encode(self, frame: TrackerInputs, training: bool = False) -> EncodedFrame:
        """TSA1 and TSA2 of one frame; the weights are shared by both frames."""
        sa1, sa2 = self.config.set_abstraction
        indices1, xyz1 = set_abstraction_indices(frame.xyz, sa1)
        indices2, xyz2 = set_abstraction_indices(xyz1, sa2)
        features1 = self.sa1(frame.xyz, frame.features, xyz1, indices1, training=training)
        features2 = self.sa2(xyz1, features1, xyz2, indices2, training=training)
        rows = tf.gather(indices1.sampled, indices2.sampled, batch_dims=1)
        return EncodedFrame((frame.xyz, xyz1, xyz2), (features1, features2), rows)

    def associate(self, previous: EncodedFrame, current: EncodedFrame, training: bool = False):
        """The association head's features (B, 512, 128) of the points of TSA2 of frame t-1."""
        return self.association(
            previous.xyz[2],
            previous.features[1],
            current.xyz[2],
            current.features[1],
            training=training,
        )

    def refine(self, previous: EncodedFrame, embedding: tf.Tensor, training: bool = False):
        """Association displacement (B, N', 3) of the kept points, from the head's features."""
        kept, xyz1, xyz2 = previous.xyz
        indices3, xyz3 = set_abstraction_indices(xyz2, self.config.refinement_abstraction)
        x = self.sa3(xyz2, embedding, xyz3, indices3, training=training)
        fp1, fp2 = self.config.refinement_upconv
        neighbors = neighbors_within(fp1.num_neighbors, fp1.radius, xyz3, xyz2)
        x = self.fp1(xyz3, x, xyz2, embedding, neighbors, training=training)
        neighbors = neighbors_within(fp2.num_neighbors, fp2.radius, xyz2, xyz1)
        x = self.fp2(xyz2, x, xyz1, previous.features[0], neighbors, training=training)
        x = self.fp3(x, None, interpolation_indices(kept, xyz1), training=training)
        return self.fc2(self.fc1(x, training=training))

    def displacement(self, previous: EncodedFrame, current: EncodedFrame, training: bool = False):
        """Association displacement (B, N', 3), metres, of the kept points of frame t-1."""
        return self.refine(previous, self.associate(previous, current, training), training)

    def call(self, previous: TrackerInputs, current: TrackerInputs, training: bool = False):
        """Two frames -> displacement (B, N', 3); both are encoded as one batch."""
        both = TrackerInputs(*(tf.concat(pair, 0) for pair in zip(previous, current, strict=True)))
        return self.displacement(*halves(self.encode(both, training)), training)
