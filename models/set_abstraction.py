"""Set abstraction (PointNet++; SA rows of Table I): sample, group, local PointNet, max."""

from typing import NamedTuple

import keras
import tensorflow as tf

from models.config import SetAbstractionConfig
from models.local_pointnet import LocalPointNet, Points
from tf_ops import farthest_point_sample, gather_point, query_ball_point


class SetAbstractionIndices(NamedTuple):
    """Indices of one SA layer: they depend on coordinates alone."""

    sampled: tf.Tensor  # (B, M) int32, rows of the finer level
    groups: tf.Tensor  # (B, M, K) int32, rows of the finer level


def set_abstraction_indices(xyz: tf.Tensor, config: SetAbstractionConfig):
    """xyz (B, N, 3) metres -> SetAbstractionIndices and the sampled points (B, M, 3)."""
    sampled = farthest_point_sample(config.num_points, xyz)
    centers = gather_point(xyz, sampled)
    groups, _ = query_ball_point(config.radius, config.num_neighbors, xyz, centers)
    return SetAbstractionIndices(sampled, groups), centers


class SetAbstraction(keras.layers.Layer):
    """Single-scale grouping: max over the ball of each sampled point of MLP([f_j ; x_j - x_i])."""

    def __init__(self, channels: int, config: SetAbstractionConfig, momentum: float, **kwargs):
        super().__init__(**kwargs)
        self.local = LocalPointNet(channels, config.widths, momentum, config.radius, name="local")
        self.channels = self.local.channels
        self.built = True

    def call(self, xyz, features, centers, indices: SetAbstractionIndices, training: bool):
        """xyz (B, N, 3), features (B, N, C) or None, centers (B, M, 3) -> (B, M, channels)."""
        return self.local(Points(xyz, features), Points(centers), indices.groups, training=training)
