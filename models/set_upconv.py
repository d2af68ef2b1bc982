"""Set upconv (FlowNet3D; FP rows of Table I that have a radius): coarse features to fine points."""

from __future__ import annotations

import keras
import tensorflow as tf

from models.config import SetUpconvConfig
from models.linear_norm import LinearNormReLU
from models.neighborhood import NeighborhoodMLP
from tf_ops import knn_point


def neighbors_within(k: int, radius: float, source_xyz: tf.Tensor, query_xyz: tf.Tensor):
    """The k nearest source points of each query point; those beyond radius give way to the nearest.

    source_xyz (B, N, 3), query_xyz (B, M, 3) metres -> (B, M, k) int32.
    """
    dist2, neighbors = knn_point(k, source_xyz, query_xyz)
    return tf.where(dist2 <= radius * radius, neighbors, neighbors[:, :, :1])


class SetUpconv(keras.layers.Layer):
    """[max over coarse neighbours of MLP([f_j ; x_j - x_i]) ; skip_i] -> last linear layer."""

    def __init__(
        self, channels: int, skip_channels: int, config: SetUpconvConfig, momentum: float, **kwargs
    ):
        super().__init__(**kwargs)
        *widths, last = config.widths
        self.pooling = NeighborhoodMLP(
            channels, tuple(widths), momentum, config.radius, name="pooling"
        )
        parts = {"pooled": self.pooling.channels, "skip": skip_channels}
        parts = {part: count for part, count in parts.items() if count}
        self.last = LinearNormReLU(parts, last, momentum, name="last")
        self.channels = last
        self.built = True

    def call(self, coarse_xyz, coarse_features, fine_xyz, skip, neighbors, training: bool):
        """coarse (B,M,3), (B,M,C); fine_xyz (B,N,3); skip (B,N,S) or None -> (B, N, channels)."""
        pooled = self.pooling(coarse_xyz, coarse_features, fine_xyz, neighbors, training=training)
        inputs = {"pooled": pooled} if skip is None else {"pooled": pooled, "skip": skip}
        return self.last(inputs, training=training)
