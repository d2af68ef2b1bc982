"""Farthest point sampling, and gathering of the sampled points."""

import tensorflow as tf

from tf_ops.devices import on_cpu
from tf_ops.grouping import group_point
from tf_ops.loading import load_library

tf.no_gradient("PointTrackNet>FarthestPointSample")


@on_cpu
def farthest_point_sample(npoint: int, xyz: tf.Tensor) -> tf.Tensor:
    """Exact farthest points in float32, the first at index 0, ties to the lowest index.

    Args:
        npoint: number of samples, >= 1. With npoint > N the rest is index 0.
        xyz: (B, N, 3) float32, metres, finite.

    Returns:
        (B, npoint) int32 indices into xyz. Not differentiable.

    Raises:
        InvalidArgumentError: NaN or infinity in xyz, N = 0, or a wrong shape.
    """
    return load_library().point_track_net_farthest_point_sample(xyz=xyz, npoint=npoint)


def gather_point(points: tf.Tensor, idx: tf.Tensor) -> tf.Tensor:
    """Rows of `points` by index; differentiable for points.

    Args:
        points: (B, N, C) float32, float16 or bfloat16.
        idx: (B, M) int32, each in [0, N).

    Returns:
        (B, M, C), of the type of points.

    Raises:
        InvalidArgumentError: an index out of range, or a wrong shape.
    """
    return group_point(points, idx)
