"""The tracker network (Table I, TRA): features of two frames -> association displacement.

Its association module (section III.2) is the probability filter, SA1, SA2 and the association head,
its refinement module (section III.3) the rest.
"""

from dataclasses import replace
from typing import NamedTuple

import keras
import tensorflow as tf

from common.errors import InputError
from models.association_head import AssociationHead
from models.boxes.box_coding import head_channels
from models.config import FUSED_FEATURES, DetectorConfig, TrackerConfig
from models.detector import DetectorInputs, DetectorOutputs
from models.feature_propagation import interpolation_indices
from models.local_pointnet import Points
from models.probability_filter import probability_filter
from models.refinement import Refinement
from models.set_abstraction import SetAbstraction
from models.tracker_indices import FrameIndices, frame_indices
from models.weight_count import check_tracker
from tf_ops import gather_point, three_interpolate

LEVELS = 4  # of the detector in Table I


class TrackerInputs(NamedTuple):
    """The detector's points and features of one frame that enter the tracker (Table IV)."""

    rows: tf.Tensor  # (B, N') int32, rows of the detector's N points
    xyz: tf.Tensor  # (B, N', 3) metres, level frame
    features: tf.Tensor  # (B, N', C)


class EncodedFrame(NamedTuple):
    """One frame after the tracker's SA1 and SA2; on a stream it serves two pairs."""

    indices: FrameIndices
    features1: tf.Tensor  # SA1: (B, 2048, 64)
    features2: tf.Tensor  # SA2: (B, 512, 128)

    @property
    def level1(self) -> Points:
        """Points of SA1 with their features."""
        return Points(self.indices.xyz1, self.features1)

    @property
    def level2(self) -> Points:
        """Points of SA2 with their features."""
        return Points(self.indices.xyz2, self.features2)


class FusedFeatures:
    """One row of Table IV: which points and features of the detector enter the tracker.

    filter+FC1, filter+FC2: the N' points that the probability filter keeps, with the features of
    that layer. DSA2+DFP2, DSA3+DFP3: the points of that set upconv layer, with its features beside
    those of the abstraction layer, which are interpolated where their points differ (DSA3 has 128
    points, DFP3 2048).
    """

    def __init__(self, config: TrackerConfig):
        self.name, self.num_kept = config.fused_features, config.num_kept_points
        self.filtered = self.name.startswith("filter")
        self.level = 2 if self.name == "DSA2+DFP2" else 3

    def channels(self, detector: DetectorConfig) -> int:
        """C of `TrackerInputs.features`."""
        if self.name == "filter+FC1":
            return detector.fc1_width
        if self.name == "filter+FC2":
            return head_channels(detector.box)
        levels = len(detector.set_abstraction)
        if levels != LEVELS:
            expected = f"expected a detector of {LEVELS} set abstraction layers"
            raise InputError(f"fused_features {self.name}: {expected}, found {levels}")
        abstraction = detector.set_abstraction[self.level - 1]
        return abstraction.widths[-1] + detector.set_upconv[self.level - 1].widths[-1]

    def __call__(self, inputs: DetectorInputs, outputs: DetectorOutputs) -> TrackerInputs:
        """Selects points and features; the detector's query points are all N points."""
        if self.filtered:
            rows = probability_filter(outputs.boxes.mask_logits, self.num_kept)
            features = outputs.fc1 if self.name == "filter+FC1" else outputs.fc2
            return TrackerInputs(
                rows, gather_point(inputs.query_xyz, rows), gather_point(features, rows)
            )
        rows = inputs.abstraction[0].sampled
        if self.level == 2:
            rows = tf.gather(rows, inputs.abstraction[1].sampled, batch_dims=1)
        xyz = inputs.level_xyz[4 - self.level]
        abstraction = outputs.abstraction[self.level - 1]
        if self.level == 3:
            indices = interpolation_indices(xyz, inputs.level_xyz[self.level])
            abstraction = three_interpolate(abstraction, indices.neighbors, indices.weights)
        features = tf.concat([abstraction, outputs.upconv[self.level - 1]], -1)
        return TrackerInputs(rows, xyz, features)


def all_fused_features(config: TrackerConfig) -> dict[str, FusedFeatures]:
    """Every row of Table IV by name, with the N' of a tracker."""
    return {name: FusedFeatures(replace(config, fused_features=name)) for name in FUSED_FEATURES}


class TrackingNetwork(keras.Model):
    """Association module (SA1, SA2, association head) and refinement module."""

    def __init__(self, detector: DetectorConfig, config: TrackerConfig, **kwargs):
        super().__init__(name="tracker", **kwargs)
        self.config, momentum = config, config.batch_norm_momentum
        self.fused_features = FusedFeatures(config)
        sa1, sa2 = config.set_abstraction
        channels = self.fused_features.channels(detector)
        check_tracker(config, channels)
        self.sa1 = SetAbstraction(channels, sa1, momentum, name="sa1")
        self.sa2 = SetAbstraction(self.sa1.channels, sa2, momentum, name="sa2")
        self.association = AssociationHead(self.sa2.channels, config, name="association")
        self.refinement = Refinement(
            self.association.channels, self.sa1.channels, config, name="refinement"
        )
        self.built = True

    def encode(self, frame: TrackerInputs, training: bool = False) -> EncodedFrame:
        """SA1 and SA2 of one frame; the weights are shared by both frames."""
        i = frame_indices(frame.xyz, self.config)
        features1 = self.sa1(frame.xyz, frame.features, i.xyz1, i.sa1, training=training)
        features2 = self.sa2(i.xyz1, features1, i.xyz2, i.sa2, training=training)
        return EncodedFrame(i, features1, features2)

    def associate(self, previous: EncodedFrame, current: EncodedFrame, training: bool = False):
        """The association head's features (B, 512, 128) of the points of SA2 of frame t-1."""
        return self.association(previous.level2, current.level2, training=training)

    def refine(self, previous: EncodedFrame, association: tf.Tensor, training: bool = False):
        """Association displacement (B, N', 3), metres, from the association head's features."""
        return self.refinement(previous.indices, previous.features1, association, training=training)

    def displacement(self, previous: EncodedFrame, current: EncodedFrame, training: bool = False):
        """Association displacement (B, N', 3), metres, of the kept points of frame t-1."""
        return self.refine(previous, self.associate(previous, current, training), training)

    def call(self, previous: TrackerInputs, current: TrackerInputs, training: bool = False):
        """Two frames -> association displacement (B, N', 3); both are encoded as one batch."""
        both = tf.nest.map_structure(lambda a, b: tf.concat([a, b], 0), previous, current)
        encoded = self.encode(both, training)
        pairs = tf.shape(previous.xyz)[0]
        first = tf.nest.map_structure(lambda x: x[:pairs], encoded)
        second = tf.nest.map_structure(lambda x: x[pairs:], encoded)
        return self.displacement(first, second, training)
