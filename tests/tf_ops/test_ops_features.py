"""group_point, gather_point and three_interpolate: values, gradients, types, errors."""

import numpy as np
import pytest
import tensorflow as tf
from helpers import ops_reference as reference

from tf_ops import (
    devices,
    gather_point,
    group_difference,
    group_point,
    load_library,
    three_interpolate,
)

InvalidArgument = tf.errors.InvalidArgumentError
TYPES = (tf.float32, tf.float16, tf.bfloat16)
RNG = np.random.default_rng(0)


def normal(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape).astype(np.float32)


def indices(limit: int, *shape: int) -> np.ndarray:
    return RNG.integers(0, limit, shape, dtype=np.int32)


def check_gradient(function, arguments, tolerance=2e-3):
    """Analytic and numeric Jacobians agree; linear functions allow large steps in float32."""
    analytic, numeric = tf.test.compute_gradient(function, arguments, delta=0.125)
    for a, n in zip(analytic, numeric, strict=True):
        assert np.abs(a).max() > 0
        np.testing.assert_allclose(a, n, atol=tolerance)


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(1, 1, 1, 1, 1), (2, 9, 5, 4, 3), (3, 4, 50, 1, 17)])
def test_group_point_matches_numpy(shape, dtype):
    batch, size, queries, neighbours, channels = shape
    points = tf.cast(normal(batch, size, channels), dtype)
    index = indices(size, batch, queries, neighbours)
    grouped = group_point(points, index)
    assert grouped.dtype == dtype
    np.testing.assert_array_equal(grouped, reference.group(points.numpy(), index))


def test_group_point_gradient_with_shared_points():
    index = np.array([[[0, 0, 2], [2, 0, 1]], [[3, 3, 3], [1, 3, 0]]], np.int32)
    check_gradient(lambda p: group_point(p, index), [normal(2, 4, 3)])
    check_gradient(lambda p: gather_point(p, index[:, 0]), [normal(2, 4, 3)])


@pytest.mark.parametrize("batch", [1, 2, 5])
@pytest.mark.parametrize("dtype", TYPES)
def test_group_point_gradient_is_summed_in_float32(dtype, batch):
    points = tf.cast(normal(batch, 7, 20), dtype)
    index = indices(7, batch, 300, 4)
    upstream = tf.cast(normal(batch, 300, 4, 20), dtype)
    with tf.GradientTape() as tape:
        tape.watch(points)
        grouped = group_point(points, index)
    grad = tape.gradient(grouped, points, upstream)
    assert grad.dtype == dtype
    expected = np.zeros(points.shape, np.float32)
    for b in range(batch):  # in the order of the entries: equal to the last bit
        np.add.at(expected[b], index[b], tf.cast(upstream[b], tf.float32).numpy())
    np.testing.assert_array_equal(grad, tf.cast(expected, dtype))


def test_group_point_second_gradient():
    index = indices(4, 1, 3, 2)

    def slope(points):
        with tf.GradientTape() as tape:
            tape.watch(points)
            total = tf.reduce_sum(group_point(points, index) ** 2)
        return tape.gradient(total, points)

    check_gradient(slope, [normal(1, 4, 2)])


@pytest.mark.parametrize("relu", [False, True])
@pytest.mark.parametrize("pairs", [0, 1, 3])
@pytest.mark.parametrize("shape", [(1, 1, 1, 1, 1), (2, 9, 5, 4, 3), (3, 4, 50, 7, 33)])
def test_group_difference_matches_numpy(shape, pairs, relu):
    batch, size, queries, neighbours, channels = shape
    points, query = normal(batch, size, channels), normal(batch, queries, channels)
    index = indices(size, batch, queries, neighbours)
    expected = reference.group(points, index) - query[:, :, None]
    pair, weight = normal(batch, queries, neighbours, pairs), normal(pairs, channels)
    for e in range(pairs):  # term by term: equal to the last bit
        expected += pair[..., e, None] * weight[e]
    given = (pair, weight) if pairs else ()
    found = group_difference(points, index, query, *given, relu=relu)
    np.testing.assert_array_equal(found, np.maximum(expected, 0) if relu else expected)


@pytest.mark.parametrize("channels", [1, 19])
def test_group_difference_lets_nan_through(channels):
    """As tf.nn.relu does."""
    points, index, query = normal(1, 4, channels), indices(3, 1, 6, 2), normal(1, 6, channels)
    points[0, 3], index[0, 2, 1] = np.nan, 3
    for relu in (False, True):
        broken = np.isnan(group_difference(points, index, query, relu=relu))
        assert broken[0, 2, 1].all() and broken.sum() == channels


@pytest.mark.parametrize("relu", [False, True])
def test_group_difference_gradients(relu):
    index = np.array([[[0, 0, 2], [2, 0, 1]], [[3, 3, 3], [1, 3, 0]]], np.int32)
    rng = np.random.default_rng(1)  # of values that no step carries across 0
    arguments = [
        rng.choice([-8.0, 8.0], shape).astype(np.float32) * scale
        for shape, scale in (((2, 4, 5), 1), ((2, 2, 5), 0.5), ((2, 2, 3, 2), 0.2), ((2, 5), 0.02))
    ]

    def call(points, query, pair, weight):
        return group_difference(points, index, query, pair, weight, relu=relu)

    assert np.abs(group_difference(arguments[0], index, arguments[1])).min() > 3
    check_gradient(call, arguments)
    check_gradient(lambda p, q: group_difference(p, index, q, relu=relu), arguments[:2])


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 5, 40, 19), (2, 40, 5, 32)])
def test_three_interpolate_matches_numpy(shape, dtype):
    batch, sparse, dense, channels = shape
    points = tf.cast(normal(batch, sparse, channels), dtype)
    index, weight = indices(sparse, batch, dense, 3), normal(batch, dense, 3)
    out = three_interpolate(points, index, weight)
    assert out.dtype == dtype
    terms = reference.group(tf.cast(points, tf.float32).numpy(), index) * weight[..., None]
    expected = (terms[:, :, 0] + terms[:, :, 1]) + terms[:, :, 2]
    np.testing.assert_array_equal(out, tf.cast(expected, dtype))


@pytest.mark.parametrize("channels", [1, 5, 33])
def test_three_interpolate_gradients(channels):
    index = np.array([[[0, 0, 2], [2, 0, 1]], [[3, 3, 3], [1, 3, 0]]], np.int32)
    points, weight = normal(2, 4, channels), normal(2, 2, 3)
    check_gradient(lambda p: three_interpolate(p, index, weight), [points])
    check_gradient(lambda w: three_interpolate(points, index, w), [weight])


@pytest.mark.parametrize("dtype", TYPES[1:])
def test_three_interpolate_gradients_in_half_precision(dtype):
    points, index, weight = normal(2, 6, 20), indices(6, 2, 30, 3), normal(2, 30, 3)
    upstream = normal(2, 30, 20)

    def gradients(kind):
        values = [tf.cast(points, kind), tf.constant(weight)]
        with tf.GradientTape() as tape:
            tape.watch(values)
            out = three_interpolate(values[0], index, values[1])
        return tape.gradient(out, values, tf.cast(upstream, kind))

    for half, full in zip(gradients(dtype), gradients(tf.float32), strict=True):
        np.testing.assert_allclose(tf.cast(half, tf.float32), full, rtol=0.02, atol=0.2)


@pytest.mark.parametrize("bad", [-1, 4, 2**31 - 1, -(2**31)])
def test_index_out_of_range(bad):
    index = np.zeros((2, 5, 3), np.int32)
    index[1, 3, 2] = bad
    message = rf"index\[1, 3, 2\] = {bad} is not in \[0, 4\)"
    points, weight = normal(2, 4, 6), normal(2, 5, 3)
    with pytest.raises(InvalidArgument, match=message):
        group_point(points, index)
    with pytest.raises(InvalidArgument, match=message):
        group_difference(points, index, normal(2, 5, 6))
    with pytest.raises(InvalidArgument, match=message):
        three_interpolate(points, index, weight)
    with pytest.raises(InvalidArgument, match=r"index\[1, 3\]"):
        gather_point(points, index[..., 2])


def test_index_into_nothing():
    points = np.zeros((1, 0, 6), np.float32)
    index, weight = np.zeros((1, 2, 3), np.int32), normal(1, 2, 3)
    for call in (
        lambda: group_point(points, index),
        lambda: group_difference(points, index, normal(1, 2, 6)),
        lambda: gather_point(points, index[..., 0]),
        lambda: three_interpolate(points, index, weight),
    ):
        with pytest.raises(InvalidArgument, match=r"= 0 is not in \[0, 0\)"):
            call()


def test_index_out_of_range_in_a_gradient():
    """No Python function makes such a call; a saved graph can."""
    raw, index = load_library(), np.full((1, 2, 3), 4, np.int32)
    with pytest.raises(InvalidArgument, match=r"index\[0, 0, 0\] = 4 is not in \[0, 4\)"):
        raw.point_track_net_group_point_grad(grad=normal(1, 2, 3, 5), index=index, size=4)
    with pytest.raises(InvalidArgument, match=r"index\[0, 0, 0\] = 4 is not in \[0, 4\)"):
        raw.point_track_net_three_interpolate_grad(
            points=normal(1, 4, 5), index=index, weight=normal(1, 2, 3), grad=normal(1, 2, 5)
        )


def test_wrong_shapes():
    with pytest.raises(InvalidArgument, match=r"\(B, N, C\) and index \(B, \.\.\.\), received"):
        group_point(normal(2, 4, 6), np.zeros((3, 5, 2), np.int32))
    points, index, query = normal(2, 4, 6), np.zeros((2, 5, 3), np.int32), normal(2, 5, 6)
    pair, weight = normal(2, 5, 3, 1), normal(1, 6)
    for bad in (
        (points, index[:1], query, pair, weight),
        (points, index, query[:, :4], pair, weight),
        (points, index, query[..., :5], pair, weight),
        (points, index, query, pair[:, :, :2], weight),
        (points, index, query, pair, normal(2, 6)),
        (points, index, query, pair, weight[:, :5]),
    ):
        with pytest.raises(InvalidArgument, match="must have shape"):
            group_difference(*bad)
    with pytest.raises(InvalidArgument, match=r"\(B, M, C\), index and weight \(B, N, 3\)"):
        three_interpolate(normal(2, 4, 6), np.zeros((2, 5, 2), np.int32), normal(2, 5, 2))


@pytest.mark.parametrize(
    "shape", [(0, 4, 5, 3, 6), (2, 4, 0, 3, 6), (2, 4, 5, 3, 0), (2, 0, 0, 3, 6)]
)
def test_empty(shape):
    batch, size, queries, neighbours, channels = shape
    points = tf.zeros((batch, size, channels))
    index = np.zeros((batch, queries, neighbours), np.int32)
    weight = tf.zeros((batch, queries, 3))
    with tf.GradientTape(persistent=True) as tape:
        tape.watch([points, weight])
        grouped = group_point(points, index)
        difference = group_difference(points, index, tf.zeros((batch, queries, channels)))
        dense = three_interpolate(points, index, weight)
    assert gather_point(points, index[..., 0]).shape == (batch, queries, channels)
    assert grouped.shape == difference.shape == (batch, queries, neighbours, channels)
    assert tape.gradient(difference, points).shape == points.shape
    assert dense.shape == (batch, queries, channels)
    assert tape.gradient(grouped, points).shape == points.shape
    assert tape.gradient(dense, points).shape == points.shape
    assert tape.gradient(dense, weight).shape == weight.shape
    np.testing.assert_array_equal(tape.gradient(grouped, points), np.zeros(points.shape))


def test_without_the_kernels_tensorflow_gives_the_same():
    """The way taken on a GPU, run here on the CPU."""
    points, index, weight = normal(2, 9, 8), indices(9, 2, 5, 3), normal(2, 5, 3)
    pair = normal(2, 5, 8), normal(2, 5, 3, 2), normal(2, 8)

    def results():
        return (
            group_point(points, index),
            three_interpolate(points, index, weight),
            group_difference(points, index, *pair),
            group_difference(points, index, pair[0], relu=True),
        )

    ours = results()
    with devices.without_fused_ops():
        theirs = results()
    np.testing.assert_array_equal(ours[0], theirs[0])
    for mine, other in zip(ours[1:], theirs[1:], strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-6)
    assert devices.has_gpu() == bool(tf.config.list_physical_devices("GPU"))


@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_without_the_kernels_rows_of_unknown_width_and_other_indices(kind):
    points, index = normal(2, 9, 8), indices(9, 2, 5, 3).astype(kind)
    expected = group_point(points, index.astype(np.int32))
    with devices.without_fused_ops():
        gather = tf.function(
            group_point, input_signature=[tf.TensorSpec([None] * 3), tf.TensorSpec([2, 5, 3], kind)]
        )
        np.testing.assert_array_equal(gather(points, index), expected)
        np.testing.assert_array_equal(group_point(points.tolist(), index.tolist()), expected)


def test_the_placement_decides(monkeypatch):
    """With a visible GPU the CPU ops run for tensors placed on the CPU alone."""
    assert devices.fused_ops() or devices.has_gpu()
    monkeypatch.setattr(devices, "has_gpu", lambda: True)
    with tf.Graph().as_default():
        assert not devices.fused_ops()
        with tf.device("/GPU:0"):
            assert not devices.fused_ops()
        with tf.device("/CPU:0"):
            assert devices.fused_ops()
