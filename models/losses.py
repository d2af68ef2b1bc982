"""The losses of section III.5, equations (2) to (5): one function per term.

Equation (1) adds those of the two networks, which are trained one after the other (section IV.B),
so their sum is never needed.

Every function returns a scalar float32: a mean over the weighted points of the local batch,
divided by `normalizer` where one is given: the shards of a joint batch add up to its loss.
"""

import tensorflow as tf

LEAST = 1e-12


def focal_loss(logits: tf.Tensor, labels: tf.Tensor, gamma: float) -> tf.Tensor:
    """Equation (4): logits (..., C), labels (...) int -> (...) -(1 - p_t)^gamma log(p_t)."""
    log_p = tf.nn.log_softmax(logits)
    log_pt = tf.gather(log_p, labels, batch_dims=labels.shape.rank)
    wrong = tf.maximum(-tf.math.expm1(log_pt), LEAST)  # 1 - p_t, above 0 for the gradient
    return -tf.pow(wrong, gamma) * log_pt


def huber(error: tf.Tensor) -> tf.Tensor:
    """Huber loss, elementwise, quadratic up to 1 (Frustum PointNets)."""
    size = tf.abs(error)
    quadratic = tf.minimum(size, 1.0)
    return 0.5 * tf.square(quadratic) + (size - quadratic)


def weighted_mean(values: tf.Tensor, weights: tf.Tensor, normalizer: tf.Tensor) -> tf.Tensor:
    """sum(values * weights) / normalizer; 0 without weights."""
    return tf.math.divide_no_nan(tf.reduce_sum(values * weights), normalizer)


def mask_loss(logits, foreground, weights, normalizer, gamma) -> tf.Tensor:
    """L_mask: logits (B, Q, 2), foreground (B, Q) int32, weights (B, Q)."""
    return weighted_mean(focal_loss(logits, foreground, gamma), weights, normalizer)


def center_loss(predicted, target, weights, normalizer) -> tf.Tensor:
    """L_center: (B, Q, 3) metres; Huber on each axis, summed."""
    return weighted_mean(tf.reduce_sum(huber(predicted - target), -1), weights, normalizer)


def heading_class_loss(scores, bins, weights, normalizer, gamma) -> tf.Tensor:
    """L_h_cls: scores (B, Q, NH), bins (B, Q) int32."""
    return weighted_mean(focal_loss(scores, bins, gamma), weights, normalizer)


def heading_regression_loss(residuals, bins, target, weights, normalizer) -> tf.Tensor:
    """L_h_reg: residuals (B, Q, NH) of which the true bin's counts, target (B, Q), half bins."""
    predicted = tf.gather(residuals, bins, batch_dims=2)
    return weighted_mean(huber(predicted - target), weights, normalizer)


def size_class_loss(scores, templates, weights, normalizer, gamma) -> tf.Tensor:
    """L_s_cls: scores (B, Q, NS), templates (B, Q) int32."""
    return weighted_mean(focal_loss(scores, templates, gamma), weights, normalizer)


def size_regression_loss(residuals, templates, target, weights, normalizer) -> tf.Tensor:
    """L_s_reg: residuals (B, Q, NS, 3) of which the true template's count, target (B, Q, 3)."""
    predicted = tf.gather(residuals, templates, batch_dims=2)
    return weighted_mean(tf.reduce_sum(huber(predicted - target), -1), weights, normalizer)


def semantic_class_loss(scores, classes, weights, normalizer, gamma) -> tf.Tensor:
    """L_sem_cls: scores (B, Q, NC), classes (B, Q) int32."""
    return weighted_mean(focal_loss(scores, classes, gamma), weights, normalizer)


def quality_loss(logits, iou, weights) -> tf.Tensor:
    """Cross entropy of the predicted quality, 0 where exact; not in the paper (after IoU-Net).

    logits (B, Q, 1), iou (B, Q) 3-D IoU of the decoded box with the object of its point, 0 on
    background; weights (B, Q), divided by their sum over the joint batch.
    """
    cross = tf.nn.sigmoid_cross_entropy_with_logits(labels=iou, logits=logits[..., 0])
    entropy = -tf.math.xlogy(iou, iou) - tf.math.xlogy(1.0 - iou, 1.0 - iou)
    return tf.reduce_sum((cross - entropy) * weights)


def detection_losses(
    predictions,
    targets,
    foreground,
    mask_weights,
    box_weights,
    mask_normalizer,
    box_normalizer,
    gamma: float,
) -> dict[str, tf.Tensor]:
    """Equations (2) and (3): their terms, unweighted, by name.

    Args:
        predictions: BoxPredictions (B, Q, ...). targets: BoxTargets (B, Q, ...).
        foreground: (B, Q) int32, 1 on foreground. mask_weights, box_weights: (B, Q) float32,
            box_weights 0 on background. normalizers: scalars, sums of weights of the joint batch.
    """
    p, t, w, n = predictions, targets, box_weights, box_normalizer
    return {
        "mask": mask_loss(p.mask_logits, foreground, mask_weights, mask_normalizer, gamma),
        "center": center_loss(p.center_offset, t.center_offset, w, n),
        "h_cls": heading_class_loss(p.heading_scores, t.heading_bin, w, n, gamma),
        "h_reg": heading_regression_loss(
            p.heading_residual_normalized, t.heading_bin, t.heading_residual_normalized, w, n
        ),
        "s_cls": size_class_loss(p.size_scores, t.size_template, w, n, gamma),
        "s_reg": size_regression_loss(
            p.size_residual_normalized, t.size_template, t.size_residual_normalized, w, n
        ),
        "sem_cls": semantic_class_loss(p.class_scores, t.semantic_class, w, n, gamma),
    }


def tracking_losses(predicted, target, positive, negative, counts) -> dict[str, tf.Tensor]:
    """Equation (5): its terms L2^pos N / N_pos and L2^neg N / N_neg, by name, divided by N.

    L2 is the distance between predicted and true displacement (section III.5), summed over the
    points of each part. Dividing by N makes each term a mean, in metres, whatever the batch. A
    frame without foreground (or background) has 0 for that term.

    Args:
        predicted, target: (B, N', 3) metres. positive, negative: (B, N') float32, 1 on foreground
            and on background; both 0 where the object has left (ignored).
        counts: (N_pos, N_neg) float32 scalars of the joint batch.
    """
    distance = tf.sqrt(tf.reduce_sum(tf.square(predicted - target), -1) + 1e-6)
    return {
        "pos": weighted_mean(distance, positive, counts[0]),
        "neg": weighted_mean(distance, negative, counts[1]),
    }


def total_loss(terms: dict[str, tf.Tensor], weights: dict[str, float]) -> tf.Tensor:
    """The weighted sum of equation (2) and (3), or (5)."""
    return tf.add_n([weights[name] * term for name, term in terms.items()])
