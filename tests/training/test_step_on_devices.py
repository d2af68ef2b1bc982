"""One training step of each network: the same loss and gradients on every device and path."""

from contextlib import contextmanager, nullcontext

import numpy as np
import pytest
import tensorflow as tf
from helpers.network_cases import SMALL_DETECTOR, SMALL_TRACKER

from kitti.sequence import open_sequences
from models.detector import Detector
from tf_ops.devices import has_gpu, without_fused_ops
from training.config import DetectorTrainingConfig, TrackerTrainingConfig
from training.detector_task import DetectorTask
from training.sampling.pipeline import fetch_to
from training.tracker_task import TrackerTask


def task_of(kind: str, sequences):
    tf.keras.utils.set_random_seed(0)
    if kind == "detector":
        return DetectorTask(DetectorTrainingConfig(SMALL_DETECTOR), sequences, [])
    return TrackerTask(
        TrackerTrainingConfig(SMALL_TRACKER), Detector(SMALL_DETECTOR), sequences, []
    )


def step(kind, sequences, by_batch: bool, device: str = ""):
    """({term: value}, the gradients as one vector) of the first two samples.

    device: that the batch is fetched to as in training on it.
    """
    task = task_of(kind, sequences)
    batch = tf.nest.map_structure(lambda *x: tf.stack(x), *(task.samples(i, i) for i in (0, 1)))
    batch = task.prepare(batch)
    if device:
        (batch,) = fetch_to(device, tf.data.Dataset.from_tensors(batch))
        assert all(device in tensor.device for tensor in tf.nest.flatten(batch))

    @tf.function(jit_compile=False)
    def both(batch):
        with tf.GradientTape() as tape:
            terms = task.losses(batch, training=by_batch)
        return terms, tape.gradient(terms["loss"], task.model.trainable_variables)

    terms, gradients = both(batch)
    vector = np.concatenate([tf.reshape(tf.convert_to_tensor(g), [-1]) for g in gradients])
    return {name: float(value) for name, value in terms.items()}, vector


@contextmanager
def gpu():
    """The GPU without its short float format, whose products have ten bits."""
    if not has_gpu():
        pytest.skip("no GPU")
    before = tf.config.experimental.tensor_float_32_execution_enabled()
    tf.config.experimental.enable_tensor_float_32_execution(False)
    with tf.device("/GPU:0"):
        yield
    tf.config.experimental.enable_tensor_float_32_execution(before)


PATHS = {"without fused ops": (without_fused_ops, "CPU:0"), "GPU": (gpu, "GPU:0")}


@pytest.mark.parametrize("by_batch", [True, False])
@pytest.mark.parametrize("kind", ["detector", "tracker"])
@pytest.mark.parametrize("path", PATHS)
def test_a_training_step_agrees(path, kind, by_batch, tiny_data):
    sequences = open_sequences(tiny_data, [0], "training")
    with tf.device("/CPU:0") if has_gpu() else nullcontext():
        terms, gradient = step(kind, sequences, by_batch)
    context, device = PATHS[path]
    with context():
        others, other_gradient = step(kind, sequences, by_batch, device)
    assert np.linalg.norm(gradient) > 0
    for name, value in terms.items():
        assert others[name] == pytest.approx(value, rel=1e-4, abs=1e-6), name
    error = np.linalg.norm(other_gradient - gradient) / np.linalg.norm(gradient)
    assert error < 1e-3
