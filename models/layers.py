"""Linear - BatchNorm - ReLU, the learnable unit of every layer of Table I (section IV.B)."""

import keras
import tensorflow as tf

from tf_ops.devices import fused_ops
from tf_ops.normalization import batch_norm_relu, batch_norm_relu_max
from tf_ops.shapes import sizes

EPSILON = 1e-3  # of BatchNorm; Keras's default
NORMALIZED = 0.5**0.5  # root mean square of relu(z), z of mean 0 and variance 1


class BatchNormReLU(keras.layers.Layer):
    """Batch normalisation over all but the last axis, then ReLU.

    Under tf.distribute the moments are those of the joint batch of all replicas, so several
    workers train to the same weights as one worker with the joint batch.
    """

    def __init__(self, channels: int, momentum: float, **kwargs):
        super().__init__(**kwargs)
        self.channels, self.momentum = channels, momentum
        self.gamma = self.add_weight(shape=(channels,), initializer="ones", name="gamma")
        self.beta = self.add_weight(shape=(channels,), initializer="zeros", name="beta")
        self.moving_mean = self.add_weight(
            shape=(channels,),
            initializer="zeros",
            trainable=False,
            name="moving_mean",
            aggregation="mean",
        )
        self.moving_variance = self.add_weight(
            shape=(channels,),
            initializer="ones",
            trainable=False,
            name="moving_variance",
            aggregation="mean",
        )
        self.built = True

    def scale_shift(self) -> tuple[tf.Tensor, tf.Tensor]:
        """(C,) tensors of y = relu(x * scale + shift), by the moving averages."""
        scale = self.gamma.value * tf.math.rsqrt(self.moving_variance.value + EPSILON)
        return scale, self.beta.value - self.moving_mean.value * scale

    def call(self, x: tf.Tensor, pool: bool = False) -> tf.Tensor:
        """Training: x (..., C) -> (..., C), by the moments of all rows; updates the averages.

        pool: x is (..., K, C), and the maximum over K is returned, (..., C).
        """
        shape, replicas = sizes(x), tf.distribute.get_replica_context()
        joint = replicas is not None and replicas.num_replicas_in_sync > 1
        if joint or not fused_ops():
            y, mean, variance = self._unfused(tf.reshape(x, [-1, self.channels]), replicas, joint)
            y = tf.reshape(y, shape)
            y = tf.reduce_max(y, -2) if pool else y
        else:
            op = batch_norm_relu_max if pool else batch_norm_relu
            rows = tf.reshape(x, [-1, shape[-2], self.channels] if pool else [-1, self.channels])
            y, mean, variance = op(rows, self.gamma.value, self.beta.value, EPSILON)
            y = tf.reshape(y, [*shape[:-2], shape[-1]] if pool else shape)
        for average, value in ((self.moving_mean, mean), (self.moving_variance, variance)):
            average.assign(self.momentum * average.value + (1 - self.momentum) * value)
        return y

    def _unfused(self, x, replicas, joint: bool) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        """TensorFlow's own ops: (R, C) -> the same, mean (C,), biased variance (C,).

        The variance is the mean square of x - mean, which keeps its digits where |mean| >> std.
        """

        def mean_of_all(values: tf.Tensor) -> tf.Tensor:
            local = tf.reduce_mean(values, 0)
            return replicas.all_reduce(tf.distribute.ReduceOp.MEAN, local) if joint else local

        mean = mean_of_all(x)
        centered = x - mean
        variance = mean_of_all(tf.square(centered))
        scale = self.gamma.value * tf.math.rsqrt(variance + EPSILON)
        return tf.nn.relu(centered * scale + self.beta.value), mean, variance


class LinearNormReLU(keras.layers.Layer):
    """relu(BatchNorm(sum of x_k W_k)): a linear layer over inputs that are not concatenated.

    W = [W_1; W_2; ...] is kept in one kernel per named input, because a linear layer commutes
    with gathering and interpolation: W [f_j ; x_j - x_i] = W_f f_j + W_x x_j - W_x x_i.

    The initial weights are Glorot's over the joint matrix for the largest input; those of the
    other inputs are larger: each input initially has an equal share of the output's variance.
    Otherwise a hundred features would dominate three coordinates.

    Args:
        inputs: number of channels of each input, by name.
        sizes: root mean square of an input's channels where it is not NORMALIZED.
    """

    def __init__(
        self,
        inputs: dict[str, int],
        width: int,
        momentum: float,
        sizes: dict[str, float] | None = None,
        **kwargs,
    ):
        super().__init__(**kwargs)
        self.width = width
        energy = {
            name: channels * (sizes or {}).get(name, NORMALIZED) ** 2
            for name, channels in inputs.items()
        }
        glorot = (6.0 / (sum(inputs.values()) + width)) ** 0.5
        self.kernels = {}
        for name, channels in inputs.items():
            limit = glorot * (max(energy.values()) / energy[name]) ** 0.5
            self.kernels[name] = self.add_weight(
                shape=(channels, width),
                initializer=keras.initializers.RandomUniform(-limit, limit),
                name=f"kernel_{name}",
            )
        self.norm = BatchNormReLU(width, momentum, name="norm")
        self._folded: tuple[dict[str, tf.Tensor], tf.Tensor] | None = None
        self.built = True

    def fold(self) -> None:
        """Multiplies BatchNorm's moving averages into W and a bias, once, for inference."""
        self._folded = self._scaled()

    def _scaled(self) -> tuple[dict[str, tf.Tensor], tf.Tensor]:
        scale, shift = self.norm.scale_shift()
        return {name: kernel.value * scale for name, kernel in self.kernels.items()}, shift

    def affine(self, training: bool) -> tuple[dict[str, tf.Tensor], tf.Tensor | None]:
        """(W_k by name, bias (width,)); the bias is None in training, where `norm` follows."""
        if training:
            return {name: kernel.value for name, kernel in self.kernels.items()}, None
        return self._folded or self._scaled()

    def call(self, inputs: dict[str, tf.Tensor], training: bool, pool: bool = False) -> tf.Tensor:
        """{name: (..., C_k)} -> (..., width); pool: the maximum over the last but one axis."""
        kernels, bias = self.affine(training)
        first, *others = inputs
        y = linear(inputs[first], kernels[first], bias if not others and not pool else None)
        for name in others:
            y += linear(inputs[name], kernels[name])
        if training:
            return self.norm(y, pool=pool)
        if pool:  # a bias and ReLU keep the order: once per group is enough
            y = tf.reduce_max(y, -2)
        return tf.nn.relu(y + bias if others or pool else y)


def linear(x: tf.Tensor, kernel: tf.Tensor, bias: tf.Tensor | None = None) -> tf.Tensor:
    """x (..., C), kernel (C, width), bias (width,) -> x W + b (..., width), one matrix product."""
    y = tf.matmul(tf.reshape(x, [-1, x.shape[-1]]), kernel)
    y = y if bias is None else tf.nn.bias_add(y, bias)  # fused with the product by TensorFlow
    return tf.reshape(y, [*sizes(x)[:-1], kernel.shape[1]])


class SharedMLP(keras.layers.Layer):
    """A chain of Linear - BatchNorm - ReLU over the last axis: (..., C) -> (..., widths[-1])."""

    def __init__(self, channels: int, widths: tuple[int, ...], momentum: float, **kwargs):
        super().__init__(**kwargs)
        self.layers = []
        for i, width in enumerate(widths):
            self.layers.append(LinearNormReLU({"x": channels}, width, momentum, name=f"linear{i}"))
            channels = width
        self.channels = channels
        self.built = True

    def call(self, x: tf.Tensor, training: bool, pool: bool = False) -> tf.Tensor:
        """(..., C) -> (..., widths[-1]); with pool (..., K, C) -> (..., widths[-1])."""
        for layer in self.layers:
            x = layer({"x": x}, training=training, pool=pool and layer is self.layers[-1])
        return x


def fold_batch_norm(layer: keras.layers.Layer) -> None:
    """Folds every BatchNorm within `layer`; it can no longer be trained by moving averages."""
    for inner in layer._flatten_layers():
        if isinstance(inner, LinearNormReLU):
            inner.fold()
