"""The tf.data input pipeline: frames from disk to batches with their pyramids of indices."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import tensorflow as tf

from common.errors import InputError
from training.sampling.data import Pool

BLOCK = 1000
"""Consecutive samples in which each pool has its exact share."""


@dataclass(frozen=True, eq=False)
class Order:
    """The sample of every step as a pure function of (seed, step), without state to save.

    Samples come from pools. In each `BLOCK` of samples every pool has its share, at random places;
    a pool is shuffled anew after each pass over it.

    Attributes:
        pools: index arrays; `shares[g]` is the share of pool g. Shares add up to 1.
        epoch_size: samples of an epoch.
    """

    pools: tuple[np.ndarray, ...]
    shares: tuple[float, ...]
    epoch_size: int
    batch_size: int
    seed: int

    @property
    def steps_per_epoch(self) -> int:
        """Whole batches in an epoch; at least one."""
        return max(1, self.epoch_size // self.batch_size)

    def batch(self, step: int) -> np.ndarray:
        """Sample indices (batch_size,) of a step, counted from 0 over all epochs."""
        positions = step * self.batch_size + np.arange(self.batch_size)
        return np.array([self._sample(int(position)) for position in positions])

    def _sample(self, position: int) -> int:
        """The sample at a position of the endless order."""
        block, place = divmod(position, BLOCK)
        turns, pattern = self._turns, self._pattern(block)
        pool = pattern[place]
        number = block * turns[pool] + np.count_nonzero(pattern[:place] == pool)
        shuffle, row = divmod(int(number), len(self.pools[pool]))
        return self._shuffle(int(pool), shuffle)[row]

    @cached_property
    def _turns(self) -> np.ndarray:
        """(pools,) samples of each pool in a block: the shares, rounded to add up to `BLOCK`."""
        exact = np.array(self.shares) * BLOCK
        turns = np.floor(exact).astype(np.int64)
        turns[np.argsort(turns - exact, kind="stable")[: BLOCK - turns.sum()]] += 1
        return turns

    def _pattern(self, block: int) -> np.ndarray:
        """(BLOCK,) the pool at each place of a block."""
        return _permuted(np.repeat(np.arange(len(self.pools)), self._turns), self.seed, 0, block)

    def _shuffle(self, pool: int, number: int) -> np.ndarray:
        return _permuted(self.pools[pool], self.seed, 1 + pool, number)


def _permuted(values: np.ndarray, *key: int) -> np.ndarray:
    return np.random.default_rng(key).permutation(values)


def make_order(
    items: Sequence[tuple[int, int]],
    pools: Sequence[Pool],
    epoch_size: int,
    batch_size: int,
    seed: int,
) -> Order:
    """The order of samples of items (sequence, frame); without pools all have the same probability.

    Raises:
        InputError: no items, or a pool without any.
    """
    sequence = np.array([item[0] for item in items], np.int64)
    pools = pools or [Pool(1.0, tuple(np.unique(sequence).tolist()))]
    rows = tuple(np.flatnonzero(np.isin(sequence, pool.sequences)) for pool in pools)
    if not all(map(len, rows)):
        raise InputError(
            "expected frames (or pairs of adjacent frames) with scans in the training sequences "
            "of every --data_root that has a --share, and of those without"
        )
    shares = tuple(pool.share for pool in pools)
    return Order(rows, shares, epoch_size or len(items), batch_size, seed)


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


class SampleErrors:
    """Keeps the first exception of a sample function; TensorFlow hands on its text alone."""

    def __init__(self):
        self.first: Exception | None = None

    def kept(self, make: Callable) -> Callable:
        """The same function, whose first exception is kept."""

        def call(index, position):
            try:
                return make(index, position)
            except Exception as error:
                self.first = self.first or error
                raise

        return call

    @contextmanager
    def raised(self) -> Iterator[None]:
        """Raises the exception that was kept in place of the error that TensorFlow makes of it."""
        try:
            yield
        except tf.errors.OpError as error:
            if self.first is None:
                raise
            raise self.first from error


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
    parallel: int = 2,
) -> tf.data.Dataset:
    """Batches of prepared samples.

    Args:
        make: (index, position) -> sample, a structure of arrays of fixed shapes.
        prepare: batch of samples -> input of the training step (indices are made here).
        batches: () -> iterator of (indices, positions), each (batch_size,) int64.
        parallel: calls of `make` at the same time.
    """
    example = make(*(int(x[0]) for x in next(iter(batches()))))
    spec = tf.TensorSpec([batch_size], tf.int64)
    data = tf.data.Dataset.from_generator(batches, output_signature=(spec, spec))
    data = data.unbatch()
    data = data.map(
        lambda index, position: numpy_map(make, example, index, position),
        num_parallel_calls=parallel,
        deterministic=True,
    )
    data = data.batch(batch_size, drop_remainder=True)
    data = data.map(prepare, num_parallel_calls=1, deterministic=True)
    options = tf.data.Options()
    options.experimental_distribute.auto_shard_policy = tf.data.experimental.AutoShardPolicy.OFF
    return data.prefetch(2).with_options(options)


def fetch_to(device: str, batches: tf.data.Dataset) -> tf.data.Dataset:
    """The batches copied to a device ahead of the step that asks for them.

    int32 becomes int64: TensorFlow keeps int32 arguments of functions on the host.
    """

    def widen(tensor):
        return tf.cast(tensor, tf.int64) if tensor.dtype == tf.int32 else tensor

    batches = batches.map(lambda batch: tf.nest.map_structure(widen, batch))
    return batches.apply(tf.data.experimental.prefetch_to_device(device))
