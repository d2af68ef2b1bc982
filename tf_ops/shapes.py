"""Shapes of tensors in a graph."""

import tensorflow as tf


def sizes(x: tf.Tensor) -> list[int | tf.Tensor]:
    """The size of each axis of x: a number where the graph knows it, which takes no op."""
    x = tf.convert_to_tensor(x)
    if x.shape.is_fully_defined():
        return x.shape.as_list()
    known, found = x.shape.as_list(), tf.unstack(tf.shape(x), len(x.shape))
    return [found[axis] if size is None else size for axis, size in enumerate(known)]
