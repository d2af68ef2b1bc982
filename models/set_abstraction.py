"""Set abstraction (PointNet++; SA rows of Table I): sample, group, local PointNet, pool."""

from __future__ import annotations

from typing import NamedTuple

import keras
import tensorflow as tf

from models.config import SetAbstractionConfig
from models.neighborhood import NeighborhoodMLP
from tf_ops import farthest_point_sample, gather_point, query_ball_point


class SetAbstractionIndices(NamedTuple):
    """Indices of one SA layer: they depend on coordinates alone."""

    sampled: tf.Tensor  # (B, M) int32, rows of the finer level
    groups: tuple[tf.Tensor, ...]  # per scale (B, M, K) int32, rows of the finer level


def set_abstraction_indices(xyz: tf.Tensor, config: SetAbstractionConfig):
    """xyz (B, N, 3) -> SetAbstractionIndices and the sampled points (B, M, 3)."""
    sampled = farthest_point_sample(config.num_points, xyz)
    centers = gather_point(xyz, sampled)
    groups = tuple(
        query_ball_point(radius, count, xyz, centers)[0]
        for radius, count in zip(config.radii, config.num_neighbors, strict=True)
    )
    return SetAbstractionIndices(sampled, groups), centers


class SetAbstraction(keras.layers.Layer):
    """Single-scale or multi-scale grouping set abstraction."""

    def __init__(self, channels: int, config: SetAbstractionConfig, momentum: float, **kwargs):
        super().__init__(**kwargs)
        self.scales = [
            NeighborhoodMLP(channels, widths, momentum, radius, name=f"scale{i}")
            for i, (radius, widths) in enumerate(zip(config.radii, config.widths, strict=True))
        ]
        self.channels = sum(scale.channels for scale in self.scales)
        self.built = True

    def call(self, xyz, features, centers, indices: SetAbstractionIndices, training: bool):
        """xyz (B,N,3), features (B,N,C) or None, centers (B,M,3) -> (B, M, self.channels)."""
        pooled = [
            scale(xyz, features, centers, group, training=training)
            for scale, group in zip(self.scales, indices.groups, strict=True)
        ]
        return pooled[0] if len(pooled) == 1 else tf.concat(pooled, axis=-1)
