"""tf.distribute strategies by name, and determinism."""

import json
import os
import re

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
        cluster, task = config["cluster"], config["task"]
        workers = cluster["worker"]
        if set(cluster) != {"worker"} or not isinstance(workers, list):
            raise KeyError("cluster")
        if not all(map(_address, workers)):
            raise KeyError("worker")
        if task["type"] != "worker" or not 0 <= int(task["index"]) < len(workers):
            raise KeyError("task")
    except (KeyError, TypeError, ValueError, RecursionError, OverflowError) as error:
        raise InputError(
            'multiworker needs TF_CONFIG: {"cluster": {"worker": ["host:port", ...]}, '
            '"task": {"type": "worker", "index": 0}}'
        ) from error
    try:
        return tf.distribute.MultiWorkerMirroredStrategy()
    except tf.errors.OpError as error:  # a port that is taken, or of another machine
        raise InputError(f"multiworker by TF_CONFIG: {error.message}") from error


def _address(worker) -> bool:
    """True for the text host:port."""
    found = re.fullmatch(r"\S+:(\d{1,5})", worker)
    return found is not None and int(found[1]) < 2**16


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
