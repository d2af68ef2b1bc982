"""The detector of Table I in plain Keras, the baseline of the timing: gather, concatenate, Dense.

The same layers, widths and indices as models/detector.py, from Keras's Dense, BatchNormalization
and ReLU, tf.gather(batch_dims=1) and reduce_max; every layer runs once per neighbour.
"""

import keras
import tensorflow as tf

from models.boxes.box_coding import head_channels
from models.config import DetectorConfig
from models.detector import POINT_FEATURES, DetectorInputs, point_features


def _mlp(widths, name: str) -> list[keras.layers.Layer]:
    layers = []
    for i, width in enumerate(widths):
        layers += [
            keras.layers.Dense(width, use_bias=False, name=f"{name}_linear{i}"),
            keras.layers.BatchNormalization(name=f"{name}_norm{i}"),
            keras.layers.ReLU(),
        ]
    return layers


def _apply(layers, x, training: bool):
    for layer in layers:
        takes_training = isinstance(layer, keras.layers.BatchNormalization)
        x = layer(x, training=training) if takes_training else layer(x)
    return x


class PlainDetector(keras.Model):
    """DetectorInputs -> the head's C channels at every query point, (B, Q, C)."""

    def __init__(self, config: DetectorConfig):
        super().__init__(name="plain_detector")
        self.kind = config.point_features
        self.abstraction = [
            _mlp(layer.widths, f"sa{i + 1}") for i, layer in enumerate(config.set_abstraction)
        ]
        self.pooling = [
            _mlp(layer.widths[:-1], f"fp{i + 1}") for i, layer in enumerate(config.set_upconv)
        ]
        self.last = [
            _mlp(layer.widths[-1:], f"fp{i + 1}_last") for i, layer in enumerate(config.set_upconv)
        ]
        self.propagation = _mlp(config.propagation_widths, "fp4")
        self.fc1 = _mlp((config.fc1_width,), "fc1")
        self.fc2 = keras.layers.Dense(head_channels(config.box), name="fc2")

    def call(self, inputs: DetectorInputs, training: bool = False):
        """As `Detector.call`, the head alone."""
        xyz = inputs.level_xyz
        features = [point_features(xyz[0], self.kind) if POINT_FEATURES[self.kind] else None]
        for i, layers in enumerate(self.abstraction):
            groups = inputs.abstraction[i].groups
            x = self._grouped(xyz[i], features[i], xyz[i + 1], groups)
            features.append(tf.reduce_max(_apply(layers, x, training), 2))
        x = features[-1]
        for i, (pooling, last) in enumerate(zip(self.pooling, self.last, strict=True)):
            grouped = self._grouped(xyz[-1 - i], x, xyz[-2 - i], inputs.upconv[i])
            pooled = tf.reduce_max(_apply(pooling, grouped, training), 2)
            x = _apply(last, tf.concat([pooled, features[-2 - i]], -1), training)
        near = tf.gather(x, inputs.propagation.neighbors, batch_dims=1)
        x = tf.reduce_sum(near * inputs.propagation.weights[..., tf.newaxis], 2)
        skip = point_features(inputs.query_xyz, self.kind)
        x = x if skip is None else tf.concat([x, skip], -1)
        return self.fc2(_apply(self.fc1, _apply(self.propagation, x, training), training))

    @staticmethod
    def _grouped(source_xyz, features, query_xyz, neighbors):
        offset = tf.gather(source_xyz, neighbors, batch_dims=1) - query_xyz[:, :, tf.newaxis]
        if features is None:
            return offset
        return tf.concat([tf.gather(features, neighbors, batch_dims=1), offset], -1)
