"""Interpolation from sparse to dense points: three nearest neighbours and weighted sums."""

import tensorflow as tf

from tf_ops.devices import fused_ops, gather_rows, on_cpu
from tf_ops.loading import load_library

tf.no_gradient("PointTrackNet>ThreeNn")


@on_cpu
def three_nn(xyz1: tf.Tensor, xyz2: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """The three points of xyz2 nearest to each point of xyz1, ties to the lower index.

    Args:
        xyz1: (B, N, 3) float32 queries, metres, finite.
        xyz2: (B, M, 3) float32 points, metres, finite.

    Returns:
        dist2: (B, N, 3) float32, SQUARED distances in metres squared, ascending.
        idx: (B, N, 3) int32 into xyz2. With M < 3 the rest repeats the nearest.
        Not differentiable.

    Raises:
        InvalidArgumentError: NaN or infinity, M = 0 with N > 0, or a wrong shape.
    """
    return load_library().point_track_net_three_nn(xyz1=xyz1, xyz2=xyz2)


def three_interpolate(points: tf.Tensor, idx: tf.Tensor, weight: tf.Tensor) -> tf.Tensor:
    """Weighted sums of three rows each; differentiable for points and weight.

    Args:
        points: (B, M, C) float32, float16 or bfloat16; sums are float32 for every type.
        idx: (B, N, 3) int32, each in [0, M).
        weight: (B, N, 3) float32.

    Returns:
        (B, N, C), of the type of points.

    Raises:
        InvalidArgumentError: an index out of range, or a wrong shape.
    """
    if not fused_ops():
        rows = tf.cast(gather_rows(points, idx), tf.float32)
        return tf.cast(tf.reduce_sum(rows * weight[..., None], axis=2), points.dtype)
    return load_library().point_track_net_three_interpolate(points=points, index=idx, weight=weight)


@tf.RegisterGradient("PointTrackNet>ThreeInterpolate")
def _three_interpolate_grad(op, grad):
    points, index, weight = op.inputs
    grad_points, grad_weight = load_library().point_track_net_three_interpolate_grad(
        points=points, index=index, weight=weight, grad=grad
    )
    return grad_points, None, grad_weight
