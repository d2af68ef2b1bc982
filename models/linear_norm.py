"""Linear - BatchNorm - ReLU, the learnable unit of every layer of Table I (section IV.B)."""

from __future__ import annotations

import keras
import tensorflow as tf

from tf_ops.devices import has_gpu
from tf_ops.normalization import batch_norm_relu, batch_norm_relu_max

EPSILON = 1e-3  # of BatchNorm; Keras's default
NORMALIZED = 0.5**0.5  # root mean square of relu(z), z of mean 0 and variance 1


class BatchNormReLU(keras.layers.Layer):
    """Batch normalisation over all but the last axis, then ReLU.

    Under tf.distribute the statistics are those of the joint batch of all replicas, so several
    workers train to what one worker with the joint batch trains to.
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
        """Inference as y = relu(x * scale + shift): two (C,) tensors."""
        scale = self.gamma.value * tf.math.rsqrt(self.moving_variance.value + EPSILON)
        return scale, self.beta.value - self.moving_mean.value * scale

    def call(self, x: tf.Tensor, pool: bool = False) -> tf.Tensor:
        """Training: x (..., C) -> (..., C), by the moments of all rows; moves the averages.

        pool: x is (..., K, C), and the maximum over K is returned, (..., C).
        """
        shape, replicas = tf.shape(x), tf.distribute.get_replica_context()
        joint = replicas is not None and replicas.num_replicas_in_sync > 1
        if joint or has_gpu():
            y, mean, variance = self._plain(tf.reshape(x, [-1, self.channels]), replicas, joint)
            y = tf.reshape(y, shape)
            y = tf.reduce_max(y, -2) if pool else y
        else:
            op = batch_norm_relu_max if pool else batch_norm_relu
            rows = tf.reshape(x, [-1, shape[-2], self.channels] if pool else [-1, self.channels])
            y, mean, variance = op(rows, self.gamma.value, self.beta.value, EPSILON)
            y = tf.reshape(y, tf.concat([shape[:-2], shape[-1:]], 0) if pool else shape)
        for average, value in ((self.moving_mean, mean), (self.moving_variance, variance)):
            average.assign(self.momentum * average.value + (1 - self.momentum) * value)
        return y

    def _plain(self, x, replicas, joint: bool) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
        moments = tf.stack([tf.reduce_mean(x, 0), tf.reduce_mean(tf.square(x), 0)])
        if joint:
            moments = replicas.all_reduce(tf.distribute.ReduceOp.MEAN, moments)
        mean, square = tf.unstack(moments)
        variance = tf.maximum(square - tf.square(mean), 0.0)
        scale = self.gamma.value * tf.math.rsqrt(variance + EPSILON)
        y = tf.nn.relu(x * scale + (self.beta.value - mean * scale))
        return y, mean, variance


class LinearNormReLU(keras.layers.Layer):
    """relu(BatchNorm(sum of x_k W_k)): one linear layer over inputs that need not be concatenated.

    W = [W_1; W_2; ...] is kept in parts, one for each of the named inputs, because a linear layer
    commutes with gathering and interpolation: W [f_j ; x_j - x_i] = W_f f_j + W_x x_j - W_x x_i.
    `project` gives x_k W_k before the rows are gathered, `finish` adds BatchNorm and ReLU after.
    At inference BatchNorm is folded into W and a bias.

    The initial weights are Glorot's over the joint matrix for the part of the largest inputs;
    those of the others are larger, so that each part starts with an equal share of the output's
    variance. Else three coordinates would be lost beside a hundred features.

    Args:
        parts: number of channels of each input.
        sizes: root mean square of an input's channels where it is not NORMALIZED.
    """

    def __init__(
        self,
        parts: dict[str, int],
        width: int,
        momentum: float,
        sizes: dict[str, float] | None = None,
        **kwargs,
    ):
        super().__init__(**kwargs)
        self.width = width
        energy = {
            part: channels * (sizes or {}).get(part, NORMALIZED) ** 2
            for part, channels in parts.items()
        }
        glorot = (6.0 / (sum(parts.values()) + width)) ** 0.5
        self.kernels = {}
        for part, channels in parts.items():
            limit = glorot * (max(energy.values()) / energy[part]) ** 0.5
            self.kernels[part] = self.add_weight(
                shape=(channels, width),
                initializer=keras.initializers.RandomUniform(-limit, limit),
                name=f"kernel_{part}",
            )
        self.norm = BatchNormReLU(width, momentum, name="norm")
        self.built = True

    def kernel(self, part: str, training: bool) -> tf.Tensor:
        """W_part (C_part, width); scaled by the folded BatchNorm at inference."""
        kernel = tf.convert_to_tensor(self.kernels[part].value)
        return kernel if training else kernel * self.norm.scale_shift()[0]

    def project(self, part: str, x: tf.Tensor, training: bool) -> tf.Tensor:
        """x (..., C_part) -> x W_part (..., width), with `kernel` for W_part."""
        y = tf.matmul(tf.reshape(x, [-1, x.shape[-1]]), self.kernel(part, training))
        return self._like(x, y)

    def _like(self, x: tf.Tensor, rows: tf.Tensor) -> tf.Tensor:
        """The rows (R, width) that were made of x (..., C) -> (..., width)."""
        return tf.reshape(rows, tf.concat([tf.shape(x)[:-1], [self.width]], 0))

    def finish(self, y: tf.Tensor, training: bool, pool: bool = False) -> tf.Tensor:
        """BatchNorm and ReLU of the sum of projections, (..., width) -> (..., width).

        pool: y is (..., K, width), and the maximum over K is returned.
        """
        if training:
            return self.norm(y, pool=pool)
        if pool:  # adding a bias and ReLU keep the order: once per group is enough
            y = tf.reduce_max(y, -2)
        return tf.nn.relu(y + self.norm.scale_shift()[1])

    def call(self, inputs: dict[str, tf.Tensor], training: bool, pool: bool = False) -> tf.Tensor:
        """{part: (..., C_part)} -> (..., width); pool: the maximum over the last but one axis."""
        if len(inputs) == 1 and not training and not pool:
            ((part, x),) = inputs.items()
            rows = tf.matmul(tf.reshape(x, [-1, x.shape[-1]]), self.kernel(part, training))
            # So written, TensorFlow adds and cuts off while it multiplies.
            rows = tf.nn.relu(tf.nn.bias_add(rows, self.norm.scale_shift()[1]))
            return self._like(x, rows)
        parts = [self.project(part, x, training) for part, x in inputs.items()]
        return self.finish(parts[0] if len(parts) == 1 else tf.add_n(parts), training, pool)


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
