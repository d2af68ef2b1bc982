"""Neighbour search, and gathering of the neighbours' features."""

import tensorflow as tf

from tf_ops.devices import fused_ops, gather_rows, on_cpu
from tf_ops.loading import load_library
from tf_ops.shapes import sizes

for _name in ("QueryBallPoint", "KnnPoint"):
    tf.no_gradient(f"PointTrackNet>{_name}")


@on_cpu
def query_ball_point(
    radius: float, nsample: int, xyz1: tf.Tensor, xyz2: tf.Tensor
) -> tuple[tf.Tensor, tf.Tensor]:
    """The first `nsample` points, in index order, closer than `radius` to each query.

    Args:
        radius: metres, > 0; squared distances are compared with radius * radius in float32.
        nsample: places for neighbours, >= 1.
        xyz1: (B, N, 3) float32 points, metres, finite.
        xyz2: (B, M, 3) float32 queries, metres, finite.

    Returns:
        idx: (B, M, nsample) int32 into xyz1; unused places repeat the first one found. In an
            empty ball all places hold the nearest point.
        count: (B, M) int32, points found, at most nsample; 0 for an empty ball.
        Not differentiable.

    Raises:
        InvalidArgumentError: NaN or infinity, N = 0 with M > 0, or a wrong shape.
    """
    return load_library().point_track_net_query_ball_point(
        xyz1=xyz1, xyz2=xyz2, radius=radius, nsample=nsample
    )


@on_cpu
def knn_point(k: int, xyz1: tf.Tensor, xyz2: tf.Tensor) -> tuple[tf.Tensor, tf.Tensor]:
    """The k nearest points of each query, nearest first, ties to the lower index.

    Args:
        k: number of neighbours, >= 1. With k > N the rest repeats the nearest.
        xyz1: (B, N, 3) float32 points, metres, finite.
        xyz2: (B, M, 3) float32 queries, metres, finite.

    Returns:
        dist2: (B, M, k) float32 squared distances, ascending; infinity where they overflow.
        idx: (B, M, k) int32 into xyz1.
        Not differentiable.

    Raises:
        InvalidArgumentError: NaN or infinity, N = 0 with M > 0, or a wrong shape.
    """
    return load_library().point_track_net_knn_point(xyz1=xyz1, xyz2=xyz2, k=k)


def group_point(points: tf.Tensor, idx: tf.Tensor) -> tf.Tensor:
    """Rows of `points` by index; differentiable for points.

    Args:
        points: (B, N, C) float32, float16 or bfloat16.
        idx: (B, M, K) int32, each in [0, N).

    Returns:
        (B, M, K, C), of the type of points.

    Raises:
        InvalidArgumentError: an index out of range, or a wrong shape. (On a GPU an index
            out of range is not noticed; its rows are those of another cloud, or 0.)
    """
    if not fused_ops():
        return gather_rows(points, idx)
    return load_library().point_track_net_group_point(points=points, index=idx)


@tf.RegisterGradient("PointTrackNet>GroupPoint")
def _group_point_grad(op, grad):
    points, index = op.inputs
    size = tf.shape(points)[1]
    library = load_library()
    return library.point_track_net_group_point_grad(grad=grad, index=index, size=size), None


@tf.RegisterGradient("PointTrackNet>GroupPointGrad")
def _group_point_grad_grad(op, grad):
    return group_point(grad, op.inputs[1]), None, None


def group_difference(
    points: tf.Tensor,
    idx: tf.Tensor,
    query: tf.Tensor,
    pair: tf.Tensor | None = None,
    weight: tf.Tensor | None = None,
    relu: bool = False,
) -> tf.Tensor:
    """points[j] - query[i] + pair[i, j] weight for the neighbours j of each i, in one pass.

    The first linear layer of a neighbourhood (PointNet++, FlowNet3D), whose products with points
    and queries are computed before grouping. Differentiable for all but idx.

    Args:
        points: (B, N, C) float32.
        idx: (B, M, K) int32, each in [0, N).
        query: (B, M, C) float32.
        pair: (B, M, K, E) float32, a few values per pair, and weight (E, C); or neither.
        relu: whether to return the positive part.

    Returns:
        (B, M, K, C) float32.

    Raises:
        InvalidArgumentError: an index out of range, or a wrong shape.
    """
    if not fused_ops():
        grouped = gather_rows(points, idx) - query[:, :, tf.newaxis, :]
        if pair is not None:
            grouped += tf.einsum("bmke,ec->bmkc", pair, weight)
        return tf.nn.relu(grouped) if relu else grouped
    if pair is None:
        pair, weight = tf.zeros([*sizes(idx), 0]), tf.zeros([0, sizes(query)[2]])
    return load_library().point_track_net_group_difference(
        points=points, index=idx, query=query, pair=pair, weight=weight, relu=relu
    )


@tf.RegisterGradient("PointTrackNet>GroupDifference")
def _group_difference_grad(op, grad):
    points, index, _, pair, weight = op.inputs
    if op.get_attr("relu"):
        grad = tf.where(op.outputs[0] > 0, grad, tf.zeros_like(grad))
    grad_points = load_library().point_track_net_group_point_grad(
        grad=grad, index=index, size=tf.shape(points)[1]
    )
    return (
        grad_points,
        None,
        -tf.reduce_sum(grad, 2),
        tf.einsum("bmkc,ec->bmke", grad, weight),
        tf.einsum("bmke,bmkc->ec", pair, grad),
    )
