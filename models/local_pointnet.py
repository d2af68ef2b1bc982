"""The local PointNet of set abstraction, set upconv and the association head: group, MLP, max."""

from typing import NamedTuple

import keras
import tensorflow as tf

from models.layers import NORMALIZED, LinearNormReLU, SharedMLP, linear
from tf_ops import group_difference

FEW_EDGE_CHANNELS = 4  # up to this many, W_e e_ij is made while the neighbours are gathered


class Points(NamedTuple):
    """Points of one level of the pyramid."""

    xyz: tf.Tensor  # (B, N, 3) metres, level frame
    features: tf.Tensor | None = None  # (B, N, C)


class LocalPointNet(keras.layers.Layer):
    """max over neighbours j of MLP([f_j ; x_j - x_i ; q_i ; e_ij]) (PointNet++, FlowNet3D).

    f_j are the neighbours' features, x coordinates, q_i the centre's features and e_ij values of
    the pair (edge); each of f, q, e may be absent.

    Args:
        channels: of f_j.
        widths: of the MLP.
        momentum: of BatchNorm's moving averages.
        radius: of the neighbourhood, metres; x_j - x_i is about half of it on each axis, which
            scales its initial weights.
        center_channels, edge_channels: of q_i and e_ij.
        edge_size: standard deviation of e_ij, which scales its initial weights.
    """

    def __init__(
        self,
        channels: int,
        widths: tuple[int, ...],
        momentum: float,
        radius: float,
        center_channels: int = 0,
        edge_channels: int = 0,
        edge_size: float = NORMALIZED,
        **kwargs,
    ):
        super().__init__(**kwargs)
        inputs = {
            "neighbors": channels,
            "xyz": 3,
            "centers": center_channels,
            "edges": edge_channels,
        }
        inputs = {name: count for name, count in inputs.items() if count}
        sizes = {"xyz": radius / 2, "edges": edge_size}
        self.first = LinearNormReLU(inputs, widths[0], momentum, sizes, name="linear0")
        self.rest = SharedMLP(widths[0], widths[1:], momentum, name="rest")
        self.channels = widths[-1]
        self.built = True

    def call(
        self,
        neighbors: Points,
        centers: Points,
        index: tf.Tensor,
        training: bool,
        edges: tf.Tensor | None = None,
    ) -> tf.Tensor:
        """Groups, applies the MLP, pools.

        Args:
            neighbors: N points; centers: M points.
            index: (B, M, K) int32 rows of `neighbors`.
            edges: (B, M, K, E) or None.

        Returns:
            (B, M, widths[-1]) float32.
        """
        kernels, bias = self.first.affine(training)
        x = grouped_linear(kernels, bias, neighbors, centers, index, edges)
        last = not self.rest.layers
        if training:
            x = self.first.norm(x, pool=last)
        elif last:
            x = tf.reduce_max(x, -2)
        return x if last else self.rest(x, training=training, pool=True)


def grouped_linear(kernels, bias, neighbors: Points, centers: Points, index, edges) -> tf.Tensor:
    """W [f_j ; x_j - x_i ; q_i ; e_ij], and relu(. + bias) where there is a bias.

    The products are made before grouping, once per point instead of once per neighbour, which
    gives the same values and gradients:
    (W_f f_j + W_x x_j) - (W_x x_i - W_q q_i) + W_e e_ij.

    Args:
        kernels: W_f "neighbors", W_x "xyz", W_q "centers", W_e "edges", each (C, width).
        bias: (width,) or None.
        neighbors, centers, index, edges: as for `LocalPointNet.call`.

    Returns:
        (B, M, K, width) float32.
    """
    points, queries = linear(neighbors.xyz, kernels["xyz"]), linear(centers.xyz, kernels["xyz"])
    if "neighbors" in kernels:
        points += linear(neighbors.features, kernels["neighbors"])
    if "centers" in kernels:
        queries -= linear(centers.features, kernels["centers"])
    queries = queries if bias is None else queries - bias
    relu = bias is not None
    if edges is None:
        return group_difference(points, index, queries, relu=relu)
    if edges.shape[-1] <= FEW_EDGE_CHANNELS:
        return group_difference(points, index, queries, edges, kernels["edges"], relu=relu)
    x = group_difference(points, index, queries) + linear(edges, kernels["edges"])
    return tf.nn.relu(x) if relu else x
