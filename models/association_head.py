"""The association head (section III.2, Fig. 4): neighbour search in frame t, fusion, MLP, max."""

import keras
import tensorflow as tf

from models.config import Fusion, TrackerConfig
from models.layers import NORMALIZED
from models.local_pointnet import LocalPointNet, Points
from models.set_upconv import neighbors_within
from tf_ops import group_point

EDGE_SIZE = {"cosine_distance": 0.05, "dot_product": 0.1}
"""Standard deviation of the fused value before training: positive features are nearly parallel."""


def fuse(
    fusion: Fusion, previous: tf.Tensor, current: tf.Tensor, neighbors: tf.Tensor
) -> tf.Tensor:
    """The fused value of Table III for every pair of a point i and its neighbour j.

    previous (B, M, C) features f_i of frame t-1, current (B, L, C) features f_j of frame t,
    neighbors (B, M, K) int32 rows of frame t
    -> (B, M, K, C) for elementwise_product, (B, M, K, 1) for cosine_distance and dot_product.
    Dot products are divided by C, to start at the scale of the other features. One matrix product
    of all M L pairs costs less than gathering the features of the M K pairs.
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
    """Fuses every point of t-1 with its K nearest points of t: features, MLP, max over the K.

    With fusion "none" the features of frame t-1 pass unchanged, and frame t is not used.
    """

    def __init__(self, channels: int, config: TrackerConfig, **kwargs):
        super().__init__(**kwargs)
        self.fusion, self.radius = config.fusion, config.association_radius
        self.num_neighbors = config.association_neighbors
        self.channels, self.local = channels, None
        self.built = True
        if self.fusion == "none":
            return
        self.has_features = config.fusion_keeps_features or self.fusion == "concat"
        edges = {"concat": 0, "elementwise_product": channels}.get(self.fusion, 1)
        single = channels if self.has_features else 0
        self.local = LocalPointNet(
            single,
            config.association_widths,
            config.batch_norm_momentum,
            self.radius,
            center_channels=single,
            edge_channels=edges,
            edge_size=EDGE_SIZE.get(self.fusion, NORMALIZED),
            name="local",
        )
        self.channels = self.local.channels

    def call(self, previous: Points, current: Points, training: bool) -> tf.Tensor:
        """Points of frame t-1 (B, M, ...) and of frame t (B, L, ...) -> (B, M, widths[-1])."""
        if self.local is None:
            return previous.features
        index = neighbors_within(self.num_neighbors, self.radius, current.xyz, previous.xyz)
        edges = None
        if self.fusion != "concat":
            edges = fuse(self.fusion, previous.features, current.features, index)
        if not self.has_features:
            previous, current = Points(previous.xyz), Points(current.xyz)
        return self.local(current, previous, index, training=training, edges=edges)
