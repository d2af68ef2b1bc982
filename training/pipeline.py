"""The tf.data input pipeline: frames from disk to batches with their pyramids of indices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tensorflow as tf


@dataclass(frozen=True)
class Order:
    """Which sample every step sees, as a pure function of (seed, step): nothing to save.

    An epoch is `epoch_size` samples; the samples are shuffled afresh whenever all were used.
    """

    num_samples: int
    epoch_size: int
    batch_size: int
    seed: int

    @property
    def steps_per_epoch(self) -> int:
        """Whole batches in an epoch; at least one."""
        return max(1, self.epoch_size // self.batch_size)

    def batch(self, step: int) -> np.ndarray:
        """Sample indices (batch_size,) of a step, counted from 0 over all epochs."""
        position = step * self.batch_size + np.arange(self.batch_size)
        rounds = position // self.num_samples
        shuffles = {r: self._shuffle(int(r)) for r in np.unique(rounds)}
        return np.array(
            [shuffles[r][p] for r, p in zip(rounds, position % self.num_samples, strict=True)]
        )

    def _shuffle(self, number: int) -> np.ndarray:
        return np.random.default_rng([self.seed, number]).permutation(self.num_samples)


def micro_batches(
    order: Order, first_step: int, last_step: int, pipeline: int, local: int, replicas: int
):
    """Yields (index, position) arrays, one micro-batch a replica, for steps first to last - 1.

    `pipeline` of this worker feeds `local` of all `replicas`; together they cover each batch once.
    """
    size = order.batch_size // replicas
    for step in range(first_step, last_step):
        indices = order.batch(step)
        for replica in range(pipeline * local, (pipeline + 1) * local):
            rows = slice(replica * size, (replica + 1) * size)
            positions = step * order.batch_size + np.arange(order.batch_size)
            yield indices[rows], positions[rows]


def numpy_map(make: Callable, example, index: tf.Tensor, position: tf.Tensor):
    """`make(index, position)` -> tensors of the structure and static shapes of `example`."""
    flat = [np.asarray(leaf) for leaf in tf.nest.flatten(example)]

    def call(i, p):
        return [np.asarray(leaf) for leaf in tf.nest.flatten(make(int(i), int(p)))]

    tensors = tf.numpy_function(call, [index, position], [leaf.dtype for leaf in flat])
    for tensor, leaf in zip(tensors, flat, strict=True):
        tensor.set_shape(leaf.shape)
    return tf.nest.pack_sequence_as(example, tensors)


def dataset(
    make: Callable,
    prepare: Callable,
    batches: Callable,
    batch_size: int,
    deterministic: bool = True,
) -> tf.data.Dataset:
    """Batches of prepared samples.

    Args:
        make: (index, position) -> sample, a structure of arrays of fixed shapes.
        prepare: batch of samples -> what the training step takes (indices are made here).
        batches: () -> iterator of (indices, positions), each (batch_size,) int64.
    """
    example = make(*(int(x[0]) for x in next(iter(batches()))))
    spec = tf.TensorSpec([batch_size], tf.int64)
    data = tf.data.Dataset.from_generator(batches, output_signature=(spec, spec))
    data = data.unbatch()
    data = data.map(
        lambda index, position: numpy_map(make, example, index, position),
        num_parallel_calls=2,
        deterministic=deterministic,
    )
    data = data.batch(batch_size, drop_remainder=True)
    data = data.map(prepare, num_parallel_calls=1, deterministic=deterministic)
    options = tf.data.Options()
    options.experimental_distribute.auto_shard_policy = tf.data.experimental.AutoShardPolicy.OFF
    return data.prefetch(2).with_options(options)
