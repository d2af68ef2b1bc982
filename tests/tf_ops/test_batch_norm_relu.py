"""Batch normalisation with ReLU, and with the maximum, against TensorFlow's own ops."""

import numpy as np
import pytest
import tensorflow as tf

from tf_ops import load_library
from tf_ops.normalization import batch_norm_relu, batch_norm_relu_max

InvalidArgument = tf.errors.InvalidArgumentError

EPSILON = 1e-3


def plain(x, gamma, beta):
    """relu(batch norm) of the rows of x, by TensorFlow, with gradients through the moments."""
    mean, variance = tf.nn.moments(x, [0])
    y = gamma * (x - mean) / tf.sqrt(variance + EPSILON) + beta
    return tf.nn.relu(y), mean, variance


def inputs(rows, channels, seed=0, offset=0.0):
    rng = np.random.default_rng(seed)
    x = rng.normal(offset, 2.0, (rows, channels)).astype(np.float32)
    gamma = rng.normal(0, 1, channels).astype(np.float32)  # both signs
    beta = rng.normal(0, 1, channels).astype(np.float32)
    return x, gamma, beta


@pytest.mark.parametrize("rows", [1, 2, 255, 256, 257, 3000])
@pytest.mark.parametrize("channels", [1, 3, 32, 130])
def test_forward_equals_tensorflow(rows, channels):
    x, gamma, beta = inputs(rows, channels)
    for found, expected in zip(
        batch_norm_relu(x, gamma, beta, EPSILON), plain(x, gamma, beta), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def in_float64(x, gamma, beta):
    """Moments and relu(batch norm) of the rows of x in float64; gradients of its squares / 2.

    Each gradient comes with the magnitude of its largest term.
    """
    x, gamma, beta = (v.astype(np.float64) for v in (x, gamma, beta))
    mean, variance = x.mean(0), x.var(0)
    inverse = 1 / np.sqrt(variance + EPSILON)
    normal = (x - mean) * inverse
    y = np.maximum(gamma * normal + beta, 0)
    d_beta, d_gamma = y.sum(0), (y * normal).sum(0)
    d_x = gamma * inverse * (y - (d_beta + normal * d_gamma) / len(x))
    scales = (np.abs(gamma * inverse * y).max(), np.abs(d_gamma).max(), np.abs(d_beta).max())
    return mean, variance, y, zip((d_x, d_gamma, d_beta), scales, strict=True)


@pytest.mark.parametrize("pooled", [False, True])
@pytest.mark.parametrize("first_row", ["like the others", 0.0])
@pytest.mark.parametrize(("offset", "rows"), [(1e3, 5000), (1e4, 5000), (-1e4, 20_000)])
def test_a_mean_far_above_the_deviation(offset, rows, first_row, pooled):
    """|mean| / std up to 1e4, also where row 0 is an outlier: float64 within float32's rounding."""
    x, gamma, beta = inputs(rows, 4, offset=offset)
    x = (x - np.float32(offset)) / 2 + np.float32(offset)  # deviation 1
    if first_row == 0.0:
        x[0] = 0.0
    op = batch_norm_relu_max if pooled else batch_norm_relu
    values = [tf.constant(v) for v in (x[:, None] if pooled else x, gamma, beta)]
    with tf.GradientTape() as tape:
        tape.watch(values)
        y, mean, variance = op(*values, EPSILON)
        loss = tf.reduce_sum(y * y) / 2
    expected_mean, expected_variance, expected_y, gradients = in_float64(x, gamma, beta)
    np.testing.assert_allclose(mean, expected_mean, rtol=1e-7)
    np.testing.assert_allclose(variance, expected_variance, rtol=1e-5)
    step = np.spacing(np.float32(abs(offset)))  # the mean is rounded to float32
    np.testing.assert_allclose(y, expected_y, rtol=1e-5, atol=2 * step)
    for found, (wanted, scale) in zip(tape.gradient(loss, values), gradients, strict=True):
        np.testing.assert_allclose(tf.reshape(found, wanted.shape), wanted, atol=2 * step * scale)


@pytest.mark.parametrize("rows", [2, 257, 1000])
def test_gradient_equals_tensorflow(rows):
    x, gamma, beta = (tf.constant(v) for v in inputs(rows, 19))
    weight = tf.constant(np.random.default_rng(1).normal(size=(rows, 19)).astype(np.float32))
    gradients = []
    for op in (lambda *a: batch_norm_relu(*a, EPSILON)[0], lambda *a: plain(*a)[0]):
        with tf.GradientTape() as tape:
            tape.watch([x, gamma, beta])
            loss = tf.reduce_sum(op(x, gamma, beta) * weight)
        gradients.append(tape.gradient(loss, [x, gamma, beta]))
    for found, expected in zip(*gradients, strict=True):
        np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-4)


@pytest.mark.parametrize(("groups", "size"), [(1, 1), (7, 5), (300, 32), (3, 500)])
def test_max_equals_tensorflow(groups, size):
    x, gamma, beta = (tf.constant(v) for v in inputs(groups * size, 17))
    weight = tf.constant(np.random.default_rng(1).normal(size=(groups, 17)).astype(np.float32))

    def fused(x, gamma, beta):
        return batch_norm_relu_max(tf.reshape(x, [groups, size, 17]), gamma, beta, EPSILON)[0]

    def separate(x, gamma, beta):
        return tf.reduce_max(tf.reshape(plain(x, gamma, beta)[0], [groups, size, 17]), 1)

    values, gradients = [], []
    for op in (fused, separate):
        with tf.GradientTape() as tape:
            tape.watch([x, gamma, beta])
            y = op(x, gamma, beta)
            loss = tf.reduce_sum(y * weight)
        values.append(y)
        gradients.append(tape.gradient(loss, [x, gamma, beta]))
    np.testing.assert_allclose(*values, rtol=1e-4, atol=1e-5)
    for found, expected in zip(*gradients, strict=True):
        np.testing.assert_allclose(found, expected, rtol=2e-3, atol=5e-4)


@pytest.mark.parametrize("argument", [0, 1, 2])
@pytest.mark.parametrize("op", [batch_norm_relu, batch_norm_relu_max])
def test_gradients_equal_differences(op, argument):
    """Numeric gradients of x, gamma and beta; no value is closer than 0.2 to the ReLU's kink."""
    rng = np.random.default_rng(3)
    x = rng.permutation(24).reshape(4, 3, 2).astype(np.float32)
    x = x if op is batch_norm_relu_max else x.reshape(12, 2)
    arguments = [x, np.array([1.5, -0.7], np.float32), np.array([0.2, 0.13], np.float32)]
    weight = rng.normal(size=(4, 2) if op is batch_norm_relu_max else (12, 2)).astype(np.float32)

    def value(changed):
        given = [changed if i == argument else a for i, a in enumerate(arguments)]
        return op(*given, EPSILON)[0] * weight

    analytic, numeric = tf.test.compute_gradient(value, [arguments[argument]], delta=0.01)
    assert np.abs(analytic[0]).max() > 0.01
    np.testing.assert_allclose(analytic[0], numeric[0], atol=1e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("op", [batch_norm_relu, batch_norm_relu_max])
def test_features_that_are_not_finite_pass_through(op, bad):
    """As with TensorFlow's ops: all of the channel is NaN, no other is touched."""
    x, gamma, beta = inputs(6, 19)
    x[4, 7] = bad
    y = op(x[:, None] if op is batch_norm_relu_max else x, gamma, beta, EPSILON)[0]
    expected = plain(x, gamma, beta)[0]
    np.testing.assert_array_equal(np.isnan(y), np.isnan(expected))
    assert np.isnan(y).all(0).tolist() == [channel == 7 for channel in range(19)]


@pytest.mark.parametrize("op", [batch_norm_relu, batch_norm_relu_max])
def test_moments_have_no_gradient(op):
    """None rather than zeros: a loss of the moments is noticed."""
    x, gamma, beta = (tf.constant(v) for v in inputs(6, 3))
    x = x[:, None] if op is batch_norm_relu_max else x
    with tf.GradientTape(persistent=True) as tape:
        tape.watch(x)
        y, mean, variance = op(x, gamma, beta, EPSILON)
    assert tape.gradient(y, x) is not None
    assert tape.gradient(mean, x) is None and tape.gradient(variance, x) is None


@pytest.mark.parametrize("size", [257, 512, 60_000])
def test_the_moments_of_large_groups(size):
    """Groups of more rows than are summed in one float32 number."""
    x, gamma, beta = inputs(2 * size, 3, offset=5.0)
    x[:size] += 3.0
    y, mean, variance = batch_norm_relu_max(x.reshape(2, size, 3), gamma, beta, EPSILON)
    expected_mean, expected_variance, expected_y, _ = in_float64(x, gamma, beta)
    np.testing.assert_allclose(mean, expected_mean, rtol=2e-7)
    np.testing.assert_allclose(variance, expected_variance, rtol=5e-7)
    np.testing.assert_allclose(y, expected_y.reshape(2, size, 3).max(1), rtol=1e-5, atol=1e-6)


def test_results_do_not_depend_on_the_run():
    x, gamma, beta = inputs(20_000, 64)
    first, second = (batch_norm_relu(x, gamma, beta, EPSILON) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_empty():
    y, mean, variance = batch_norm_relu(
        np.zeros((0, 3), np.float32), np.ones(3, np.float32), np.zeros(3, np.float32), EPSILON
    )
    assert y.shape == (0, 3)
    np.testing.assert_array_equal(mean, 0)
    np.testing.assert_array_equal(variance, 0)


def test_empty_maximum():
    one, zero = np.ones(3, np.float32), np.zeros(3, np.float32)
    y, mean, _ = batch_norm_relu_max(np.zeros((0, 4, 3), np.float32), one, zero, EPSILON)
    assert y.shape == (0, 3) and mean.numpy().tolist() == [0, 0, 0]
    y, mean, _ = batch_norm_relu_max(np.zeros((2, 4, 0), np.float32), one[:0], one[:0], EPSILON)
    assert y.shape == (2, 0) and mean.shape == (0,)


def test_wrong_arguments_are_named():
    x, gamma, beta = inputs(4, 3)
    with pytest.raises(InvalidArgument, match=r"input 1 must have shape \(C\) = \(3\)"):
        batch_norm_relu(x, gamma[:2], beta, EPSILON)
    with pytest.raises(InvalidArgument, match=r"input 2 must have shape \(C\) = \(3\)"):
        batch_norm_relu_max(x[None], gamma, beta[:2], EPSILON)
    with pytest.raises(InvalidArgument, match=r"\(R, C\), received \[1,4,3\]"):
        batch_norm_relu(x[None], gamma, beta, EPSILON)
    for wrong in (x, x[:, None][:, :0]):
        with pytest.raises(InvalidArgument, match=r"\(G, K, C\) with K >= 1, received"):
            batch_norm_relu_max(wrong, gamma, beta, EPSILON)
    for wrong in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(InvalidArgument, match="epsilon must be positive and finite"):
            batch_norm_relu(x, gamma, beta, wrong)


def test_wrong_arguments_of_a_gradient_are_named():
    """No Python function makes such a call; a saved graph can."""
    x, gamma, beta = inputs(4, 3)
    raw = load_library()
    small = {"gamma": gamma, "beta": beta, "mean": gamma, "variance": beta**2}
    with pytest.raises(InvalidArgument, match=r"grad must have shape \[4,3\], received \[2,3\]"):
        raw.point_track_net_batch_norm_relu_grad(grad=x[:2], x=x, epsilon=EPSILON, **small)
    place = np.zeros((1, 3), np.int32)
    for grad, chosen, message in (
        (x[:2], place, r"grad must have shape \[1,3\], received \[2,3\]"),
        (x[:1], place[:, :2], r"place must have shape \[1,3\], received \[1,2\]"),
        (x[:1], place + 4, r"place\[0, 0\] = 4 is not in \[0, 4\)"),
        (x[:1], place - 1, r"place\[0, 0\] = -1 is not in \[0, 4\)"),
    ):
        with pytest.raises(InvalidArgument, match=message):
            raw.point_track_net_batch_norm_relu_max_grad(
                grad=grad, x=x[None], place=chosen, epsilon=EPSILON, **small
            )


def test_shapes_under_unknown_batch():
    @tf.function(
        input_signature=[tf.TensorSpec([None, 32, 5]), tf.TensorSpec([5]), tf.TensorSpec([5])]
    )
    def pooled(x, gamma, beta):
        y, mean, _ = batch_norm_relu_max(x, gamma, beta, EPSILON)
        assert y.shape.as_list() == [None, 5]
        assert mean.shape.as_list() == [5]
        return y

    x, gamma, beta = inputs(64, 5)
    assert pooled(x.reshape(2, 32, 5), gamma, beta).shape == (2, 5)
