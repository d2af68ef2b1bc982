"""Equations (2) to (5) against values worked out by hand."""

import math

import numpy as np
import pytest
import tensorflow as tf

from models import losses


def test_focal_loss_by_hand():
    logits = tf.constant([[0.0, 0.0], [0.0, math.log(3.0)]])  # p = 1/2, 1/2 and 1/4, 3/4
    found = losses.focal_loss(logits, tf.constant([1, 1]), gamma=2.0)
    expected = [-((1 - 0.5) ** 2) * math.log(0.5), -((1 - 0.75) ** 2) * math.log(0.75)]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_focal_loss_with_gamma_0_is_cross_entropy():
    logits = tf.random.normal([5, 4], seed=1)
    labels = tf.constant([0, 1, 2, 3, 1])
    expected = tf.nn.sparse_softmax_cross_entropy_with_logits(labels, logits)
    np.testing.assert_allclose(losses.focal_loss(logits, labels, 0.0), expected, rtol=1e-5)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0, 2.0])
def test_focal_loss_is_finite_where_the_network_is_sure(gamma):
    logits = tf.Variable([[100.0, -100.0]])
    with tf.GradientTape() as tape:
        loss = tf.reduce_sum(losses.focal_loss(logits, tf.constant([0]), gamma))
    assert float(loss) == 0.0
    assert np.isfinite(tape.gradient(loss, logits)).all()


def test_huber_by_hand():
    np.testing.assert_allclose(losses.huber(tf.constant([0.5, -3.0])), [0.125, 0.5 + 2.0])


def test_weighted_mean_of_nothing_is_0():
    assert float(losses.weighted_mean(tf.ones(3), tf.zeros(3), tf.constant(0.0))) == 0.0


def test_tracking_losses_by_hand():
    predicted = tf.constant([[[1.0, 0, 0], [0, 2.0, 0], [9.0, 9.0, 9.0]]])
    target = tf.zeros_like(predicted)
    positive, negative = tf.constant([[1.0, 0, 0]]), tf.constant([[0.0, 1.0, 0]])
    terms = losses.tracking_losses(predicted, target, positive, negative, (1.0, 1.0))
    assert float(terms["pos"]) == pytest.approx(1.0, abs=1e-5)
    assert float(terms["neg"]) == pytest.approx(2.0, abs=1e-5)


def test_a_frame_without_foreground_is_defined():
    zeros = tf.zeros([1, 4, 3])
    terms = losses.tracking_losses(zeros, zeros, tf.zeros([1, 4]), tf.ones([1, 4]), (0.0, 4.0))
    assert float(terms["pos"]) == 0.0
    assert float(terms["neg"]) == pytest.approx(1e-3, abs=1e-6)  # sqrt(1e-6): smooth at 0


def test_total_is_the_weighted_sum():
    terms = {"a": tf.constant(2.0), "b": tf.constant(3.0)}
    assert float(losses.total_loss(terms, {"a": 0.5, "b": 2.0})) == 0.5 * 2 + 2.0 * 3
