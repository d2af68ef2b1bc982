"""Set upconv (FlowNet3D; FP rows of Table I that have a radius): coarse features to fine points."""

import keras
import tensorflow as tf

from models.config import SetUpconvConfig
from models.layers import LinearNormReLU
from models.local_pointnet import LocalPointNet, Points
from tf_ops import knn_point


def neighbors_within(k: int, radius: float, neighbor_xyz: tf.Tensor, center_xyz: tf.Tensor):
    """The k nearest neighbours; those outside the radius are replaced by the nearest.

    neighbor_xyz (B, N, 3), center_xyz (B, M, 3) metres -> (B, M, k) int32 rows of neighbor_xyz.
    """
    dist2, index = knn_point(k, neighbor_xyz, center_xyz)
    return tf.where(dist2 <= radius * radius, index, index[:, :, :1])


class SetUpconv(keras.layers.Layer):
    """[max over coarse neighbours of MLP([f_j ; x_j - x_i]) ; skip_i] -> last linear layer."""

    def __init__(
        self, channels: int, skip_channels: int, config: SetUpconvConfig, momentum: float, **kwargs
    ):
        super().__init__(**kwargs)
        *widths, last = config.widths
        self.local = LocalPointNet(channels, tuple(widths), momentum, config.radius, name="local")
        inputs = {"pooled": self.local.channels, "skip": skip_channels}
        inputs = {name: count for name, count in inputs.items() if count}
        self.last = LinearNormReLU(inputs, last, momentum, name="last")
        self.channels = last
        self.built = True

    def call(self, coarse: Points, fine: Points, index, training: bool):
        """coarse (B, M, ...), fine (B, N, ...), index (B, N, K) int32 -> (B, N, channels).

        The features of `fine` are the skip connection.
        """
        pooled = self.local(coarse, Points(fine.xyz), index, training=training)
        inputs = {"pooled": pooled}
        if fine.features is not None:
            inputs["skip"] = fine.features
        return self.last(inputs, training=training)
