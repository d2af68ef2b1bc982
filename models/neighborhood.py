"""The local region network shared by set abstraction, set upconv and the association head."""

from __future__ import annotations

import keras
import tensorflow as tf

from models.linear_norm import NORMALIZED, LinearNormReLU, SharedMLP
from tf_ops import group_difference

FEW_PAIR_CHANNELS = 4  # up to here e_ij is multiplied while the neighbours are gathered


class NeighborhoodMLP(keras.layers.Layer):
    """max over neighbours j of MLP([f_j ; x_j - x_i ; q_i ; e_ij]) (PointNet++, FlowNet3D).

    The first linear layer is applied before grouping, once per point instead of once per
    neighbour; the result is the same, gradients included:
    W [f_j ; x_j - x_i ; q_i ; e_ij] = (W_f f_j + W_x x_j) - (W_x x_i - W_q q_i) + W_e e_ij.

    Args:
        source_channels, query_channels, pair_channels: channels of f_j, q_i and e_ij.
        widths: of the MLP.
        momentum: of BatchNorm's moving averages.
        radius: of the neighbourhood, metres; x_j - x_i is about half of it on each axis, which
            scales its initial weights.
        pair_size: how far e_ij varies, which scales its initial weights.
    """

    def __init__(
        self,
        source_channels: int,
        widths: tuple[int, ...],
        momentum: float,
        radius: float,
        query_channels: int = 0,
        pair_channels: int = 0,
        pair_size: float = NORMALIZED,
        **kwargs,
    ):
        super().__init__(**kwargs)
        parts = {
            "source": source_channels,
            "xyz": 3,
            "query": query_channels,
            "pair": pair_channels,
        }
        parts = {part: channels for part, channels in parts.items() if channels}
        sizes = {"xyz": radius / 2, "pair": pair_size}
        self.first = LinearNormReLU(parts, widths[0], momentum, sizes, name="linear0")
        self.rest = SharedMLP(widths[0], widths[1:], momentum, name="rest")
        self.channels = widths[-1]
        self.built = True

    def call(
        self,
        source_xyz,
        source_features,
        query_xyz,
        neighbors,
        training: bool,
        query_features=None,
        pair_features=None,
    ) -> tf.Tensor:
        """Pools the neighbours of each query point.

        Args:
            source_xyz: (B, N, 3) metres; source_features: (B, N, C) or None if C is 0.
            query_xyz: (B, M, 3) metres; neighbors: (B, M, K) int32 rows of source.
            query_features: (B, M, Q) or None; pair_features: (B, M, K, E) or None.

        Returns:
            (B, M, widths[-1]) float32.
        """
        first = self.first
        source = first.project("xyz", source_xyz, training)
        if source_features is not None:
            source += first.project("source", source_features, training)
        query = first.project("xyz", query_xyz, training)
        if query_features is not None:
            query -= first.project("query", query_features, training)
        last = not self.rest.layers
        x = self._first_layer(source, query, neighbors, pair_features, training, pool=last)
        return x if last else self.rest(x, training=training, pool=True)

    def _first_layer(self, source, query, neighbors, pair, training: bool, pool: bool):
        """What follows the projections: (B, M, K, widths[0]), or its maximum over K if pool."""
        first = self.first
        if pair is not None and pair.shape[-1] > FEW_PAIR_CHANNELS:
            x = group_difference(source, neighbors, query)
            return first.finish(x + first.project("pair", pair, training), training, pool)
        kernel = None if pair is None else first.kernel("pair", training)
        if training:
            return first.finish(
                group_difference(source, neighbors, query, pair, kernel), training, pool
            )
        query -= first.norm.scale_shift()[1]
        x = group_difference(source, neighbors, query, pair, kernel, relu=True)
        return tf.reduce_max(x, -2) if pool else x
