"""Feature propagation (PointNet++; FP rows of Table I without a radius)."""

from typing import NamedTuple

import keras
import tensorflow as tf

from models.layers import LinearNormReLU, SharedMLP, linear
from tf_ops import three_interpolate, three_nn


class InterpolationIndices(NamedTuple):
    """The three nearest coarse points of each fine point, with inverse-distance weights."""

    neighbors: tf.Tensor  # (B, N, 3) int32
    weights: tf.Tensor  # (B, N, 3) float32, sum 1


def interpolation_indices(fine_xyz: tf.Tensor, coarse_xyz: tf.Tensor) -> InterpolationIndices:
    """fine_xyz (B, N, 3), coarse_xyz (B, M, 3) metres (PointNet++, equation 2)."""
    dist2, neighbors = three_nn(fine_xyz, coarse_xyz)
    inverse = 1.0 / tf.maximum(dist2, 1e-10)
    return InterpolationIndices(neighbors, inverse / tf.reduce_sum(inverse, -1, keepdims=True))


class FeaturePropagation(keras.layers.Layer):
    """MLP([interpolated coarse features ; skip]).

    Interpolation commutes with the first linear layer, which therefore runs on the coarse points.
    """

    def __init__(
        self, channels: int, skip_channels: int, widths: tuple[int, ...], momentum: float, **kwargs
    ):
        super().__init__(**kwargs)
        inputs = {"coarse": channels, "skip": skip_channels}
        inputs = {name: count for name, count in inputs.items() if count}
        self.first = LinearNormReLU(inputs, widths[0], momentum, name="linear0")
        self.rest = SharedMLP(widths[0], widths[1:], momentum, name="rest")
        self.channels = widths[-1]
        self.built = True

    def call(self, coarse_features, skip, indices: InterpolationIndices, training: bool):
        """coarse_features (B, M, C), skip (B, N, S) or None -> (B, N, widths[-1])."""
        kernels, bias = self.first.affine(training)
        x = linear(coarse_features, kernels["coarse"], bias)  # the weights' sum is 1: bias, too
        x = three_interpolate(x, indices.neighbors, indices.weights)
        if skip is not None:
            x += linear(skip, kernels["skip"])
        x = self.first.norm(x) if training else tf.nn.relu(x)
        return self.rest(x, training=training)
