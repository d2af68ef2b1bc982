"""tf.distribute strategies by name, and determinism."""

import json
import os

import keras
import tensorflow as tf

from common.errors import InputError


def make_strategy(name: str) -> tf.distribute.Strategy:
    """one: this process's default device; mirrored: all its GPUs; multiworker: TF_CONFIG's workers.

    Must be called before anything else uses TensorFlow (multiworker).

    Raises:
        InputError: multiworker without a usable TF_CONFIG.
    """
    if name == "one":
        return tf.distribute.get_strategy()
    if name == "mirrored":
        return tf.distribute.MirroredStrategy(_devices())
    try:
        config = json.loads(os.environ["TF_CONFIG"])
        workers, task = config["cluster"]["worker"], config["task"]
        if task["type"] != "worker" or not 0 <= int(task["index"]) < len(workers):
            raise KeyError("task")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            'multiworker needs TF_CONFIG: {"cluster": {"worker": ["host:port", ...]}, '
            '"task": {"type": "worker", "index": 0}}'
        ) from error
    return tf.distribute.MultiWorkerMirroredStrategy()


def _devices() -> list[str] | None:
    """All GPUs; without any, the logical CPUs."""
    if tf.config.list_logical_devices("GPU"):
        return None
    return [device.name for device in tf.config.list_logical_devices("CPU")]


def seed_everything(seed: int, deterministic: bool) -> None:
    """Seeds initial weights; `deterministic` also selects deterministic ops."""
    keras.utils.set_random_seed(seed)
    if deterministic:
        tf.config.experimental.enable_op_determinism()
