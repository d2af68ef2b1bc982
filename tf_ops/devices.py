"""Where the ops run: index ops always on the CPU, features where the model is."""

from __future__ import annotations

import functools

import tensorflow as tf


def on_cpu(function):
    """Pins the ops that `function` makes to the CPU: their kernels exist for no other device."""

    @functools.wraps(function)
    def pinned(*args, **kwargs):
        with tf.device("/CPU:0"):
            return function(*args, **kwargs)

    return pinned


@functools.cache
def has_gpu() -> bool:
    """Whether a GPU is visible; features then move by tf.gather, which runs on it."""
    return bool(tf.config.list_physical_devices("GPU"))
