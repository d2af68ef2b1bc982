"""Placement of the ops: index ops on the CPU, feature ops on the device of the model."""

import contextlib
import functools
import os
from collections.abc import Iterator
from pathlib import Path

import tensorflow as tf

NVIDIA_DRIVER = Path("/proc/driver/nvidia/version")
_unfused: list[bool] = []  # one for each `without_fused_ops` block


def on_cpu(function):
    """Pins the ops of `function` to the CPU, the only device that has kernels for them."""

    @functools.wraps(function)
    def pinned(*args, **kwargs):
        with tf.device("/CPU:0"):
            return function(*args, **kwargs)

    return pinned


@functools.cache
def has_gpu() -> bool:
    """True if TensorFlow may place ops on a GPU."""
    return bool(tf.config.get_visible_devices("GPU"))


def fused_ops() -> bool:
    """True if features use this project's CPU ops, False if TensorFlow's own.

    TensorFlow's own run where the ops made now may be placed on a GPU: one is visible, and no
    enclosing tf.device selects the CPU.
    """
    if _unfused:
        return False
    return not has_gpu() or "CPU" in default_device()


def default_device() -> str:
    """The device on which TensorFlow places ops made now."""
    return tf.constant(0.0).device


@contextlib.contextmanager
def without_fused_ops() -> Iterator[None]:
    """Features go through TensorFlow's own ops in this block, as on a GPU."""
    _unfused.append(True)
    try:
        yield
    finally:
        _unfused.pop()


def gather_rows(points: tf.Tensor, idx: tf.Tensor) -> tf.Tensor:
    """points (B, N, C), idx (B, ...) -> (B, ..., C), by TensorFlow's own ops.

    One flat gather with int64 rows: TensorFlow does int32 arithmetic on the CPU, also where the
    features are on a GPU.
    """
    points, idx = tf.convert_to_tensor(points), tf.convert_to_tensor(idx)
    size = tf.shape(points, tf.int64)
    channels = size[2] if points.shape[2] is None else points.shape[2]
    first = tf.reshape(tf.range(size[0]) * size[1], [-1] + [1] * (len(idx.shape) - 1))
    return tf.gather(tf.reshape(points, [-1, channels]), tf.cast(idx, tf.int64) + first)


def describe_device() -> str:
    """The device that networks run on, and why not the GPU where one is there but unusable.

    Makes GPU memory grow with use. Call it before the first op.
    """
    gpus = tf.config.get_visible_devices("GPU")
    for gpu in gpus:
        tf.config.experimental.set_memory_growth(gpu, True)
    if gpus:
        names = [tf.config.experimental.get_device_details(g).get("device_name", g) for g in gpus]
        return f"device: GPU, {', '.join(map(str, names))}"
    reason = ""
    if NVIDIA_DRIVER.exists():
        reason = (
            "; the NVIDIA GPU is not used: TensorFlow found no CUDA libraries (make venv GPU=1)"
            if tf.test.is_built_with_cuda()
            else "; the NVIDIA GPU is not used: this TensorFlow is built without CUDA"
        )
    return f"device: CPU, {len(os.sched_getaffinity(0))} cores{reason}"
