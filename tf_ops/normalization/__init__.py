"""Batch normalisation fused with ReLU, and with the maximum over neighbours (training only)."""

from typing import Any

import tensorflow as tf

from tf_ops.loading import load_library


def batch_norm_relu(
    x: tf.Tensor, gamma: tf.Tensor, beta: tf.Tensor, epsilon: float
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """relu(gamma * (x - mean) / sqrt(variance + epsilon) + beta) with the moments of x.

    The moments are exact to float32 for any ratio of mean and deviation (`batch_norm.h`).

    Args:
        x: (R, C) float32.
        gamma: (C,) float32.
        beta: (C,) float32.
        epsilon: added to the variance, > 0.

    Returns:
        y (R, C), differentiable for x, gamma and beta; mean (C,) and biased variance (C,) of the
        rows of x, not differentiable, 0 if R = 0.

    Raises:
        InvalidArgumentError: a wrong shape, or epsilon <= 0.
    """
    y, mean, variance = load_library().point_track_net_batch_norm_relu(
        x=x, gamma=gamma, beta=beta, epsilon=epsilon
    )
    return y, tf.stop_gradient(mean), tf.stop_gradient(variance)


def batch_norm_relu_max(
    x: tf.Tensor, gamma: tf.Tensor, beta: tf.Tensor, epsilon: float
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """The maximum over axis 1 of batch_norm_relu over the rows of x, computed without them.

    Normalisation and ReLU are monotonic in x, so the largest x of each group (the smallest where
    gamma < 0) is found first, in the pass over x for the moments, and normalised alone.

    Args:
        x: (G, K, C) float32, K >= 1.
        gamma: (C,) float32.
        beta: (C,) float32.
        epsilon: added to the variance, > 0.

    Returns:
        y (G, C), differentiable for x, gamma and beta; mean (C,) and biased variance (C,) of the
        G * K rows of x, not differentiable, 0 if G = 0.

    Raises:
        InvalidArgumentError: a wrong shape, or epsilon <= 0.
    """
    y, mean, variance, _ = load_library().point_track_net_batch_norm_relu_max(
        x=x, gamma=gamma, beta=beta, epsilon=epsilon
    )
    return y, tf.stop_gradient(mean), tf.stop_gradient(variance)


@tf.RegisterGradient("PointTrackNet>BatchNormRelu")
def _batch_norm_relu_grad(op, grad, *_):
    return load_library().point_track_net_batch_norm_relu_grad(**_forward(op), grad=grad)


@tf.RegisterGradient("PointTrackNet>BatchNormReluMax")
def _batch_norm_relu_max_grad(op, grad, *_):
    return load_library().point_track_net_batch_norm_relu_max_grad(
        **_forward(op), grad=grad, place=op.outputs[3]
    )


def _forward(op) -> dict[str, Any]:
    """Inputs and moments of the forward op, for its gradient."""
    names = ("x", "gamma", "beta", "mean", "variance")
    tensors = dict(zip(names, [*op.inputs, *op.outputs[1:3]], strict=True))
    return {**tensors, "epsilon": op.get_attr("epsilon")}
