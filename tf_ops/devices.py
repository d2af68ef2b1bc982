"""Placement of the ops: index ops on the CPU, feature ops on the device of the model."""

from __future__ import annotations

import functools

import tensorflow as tf


def on_cpu(function):
    """Pins the ops of `function` to the CPU, the only device that has kernels for them."""

    @functools.wraps(function)
    def pinned(*args, **kwargs):
        with tf.device("/CPU:0"):
            return function(*args, **kwargs)

    return pinned


@functools.cache
def has_gpu() -> bool:
    """Whether a GPU is visible; features are then gathered by tf.gather, which runs on it."""
    return bool(tf.config.list_physical_devices("GPU"))
