"""The association head (section III.2, Fig. 4): fuses the features of two frames."""

from __future__ import annotations

import keras
import tensorflow as tf

from models.config import Fusion
from models.linear_norm import NORMALIZED
from models.neighborhood import NeighborhoodMLP
from models.set_upconv import neighbors_within
from tf_ops import group_point

PAIR_SIZE = {"cosine_distance": 0.05, "dot_product": 0.1}
"""How far the fused value varies at first: features of one sign are nearly parallel."""


def fuse(
    fusion: Fusion, previous: tf.Tensor, current: tf.Tensor, neighbors: tf.Tensor
) -> tf.Tensor:
    """The fused value of Table III for every pair of a point i and its neighbour j.

    previous (B, M, C) features f_i of frame t-1, current (B, L, C) features f_j of frame t,
    neighbors (B, M, K) int32 rows of frame t
    -> (B, M, K, C) for elementwise_product, (B, M, K, 1) for cosine_distance and dot_product.
    Dot products are divided by C, to start at the scale of the other features. One matrix product
    of all M L pairs costs less than to move the features of the M K pairs that are asked for.
    """
    if fusion == "elementwise_product":
        return previous[:, :, tf.newaxis, :] * group_point(current, neighbors)
    if fusion == "dot_product":
        previous = previous / float(previous.shape[-1])
    else:
        previous, current = _unit(previous), _unit(current)
    pairs = tf.matmul(previous, current, transpose_b=True)  # (B, M, L)
    return tf.gather(pairs, neighbors, batch_dims=2)[..., tf.newaxis]


def _unit(features: tf.Tensor) -> tf.Tensor:
    return features * tf.math.rsqrt(tf.reduce_sum(tf.square(features), -1, keepdims=True) + 1e-8)


class AssociationHead(keras.layers.Layer):
    """For every point of t-1: its K nearest points of t, features fused, MLP, max over the K."""

    def __init__(
        self,
        channels: int,
        fusion: Fusion,
        keeps_features: bool,
        radius: float,
        num_neighbors: int,
        widths: tuple[int, ...],
        momentum: float,
        **kwargs,
    ):
        super().__init__(**kwargs)
        self.fusion, self.radius, self.num_neighbors = fusion, radius, num_neighbors
        self.has_features = keeps_features or fusion == "concat"
        pair = {"concat": 0, "elementwise_product": channels}.get(fusion, 1)
        single = channels if self.has_features else 0
        self.mlp = NeighborhoodMLP(
            single,
            widths,
            momentum,
            radius,
            query_channels=single,
            pair_channels=pair,
            pair_size=PAIR_SIZE.get(fusion, NORMALIZED),
            name="mlp",
        )
        self.channels = self.mlp.channels
        self.built = True

    def call(self, xyz_previous, features_previous, xyz, features, training: bool) -> tf.Tensor:
        """Frame t-1 (B,M,3), (B,M,C) and frame t (B,L,3), (B,L,C) -> (B, M, widths[-1])."""
        neighbors = neighbors_within(self.num_neighbors, self.radius, xyz, xyz_previous)
        pair = None
        if self.fusion != "concat":
            pair = fuse(self.fusion, features_previous, features, neighbors)
        kept = (features, features_previous) if self.has_features else (None, None)
        return self.mlp(
            xyz,
            kept[0],
            xyz_previous,
            neighbors,
            training=training,
            query_features=kept[1],
            pair_features=pair,
        )
