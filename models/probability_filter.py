"""The probability filter (section III.2): keep the N' points most probably foreground."""

import tensorflow as tf


def foreground_probability(mask_logits: tf.Tensor) -> tf.Tensor:
    """(B, N, 2) -> (B, N)."""
    return tf.sigmoid(mask_logits[..., 1] - mask_logits[..., 0])


def probability_filter(mask_logits: tf.Tensor, num_kept: int) -> tf.Tensor:
    """Rows of the num_kept points of highest foreground probability, highest first.

    mask_logits (B, N, 2) -> (B, num_kept) int32. If N < num_kept, the rows are repeated in order.
    """
    margin = mask_logits[..., 1] - mask_logits[..., 0]
    order = tf.math.top_k(margin, tf.minimum(tf.shape(margin)[1], num_kept)).indices
    repeated = tf.range(num_kept) % tf.shape(order)[1]
    return tf.ensure_shape(tf.gather(order, repeated, axis=1), [margin.shape[0], num_kept])
