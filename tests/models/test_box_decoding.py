"""From points to boxes: one box for each object, and nothing from nothing."""

from __future__ import annotations

import numpy as np
import pytest
import tensorflow as tf
from test_box_coding import predictions_of

from models.box_coding import encode_boxes
from models.config import BoxCodingConfig
from models.detections import DecodingConfig, _rank_in_group, _vote, decode_detections

CONFIG = BoxCodingConfig()
BOXES = np.array([[10, 0, 0, 3.9, 1.6, 1.5, 0.3], [20, 5, 0, 4.9, 1.9, 2.2, -2.0]])


def scene(noise=0.0, per_object=40, seed=0):
    """Points of two objects, and predictions that are right up to noise; one more background."""
    rng = np.random.default_rng(seed)
    owner = np.repeat([0, 1], per_object)
    points = (BOXES[owner, :3] + rng.uniform(-1, 1, (len(owner), 3))).astype("f4")
    targets = encode_boxes(points, BOXES[owner], owner.astype(np.int32), CONFIG)
    offset = targets.center_offset + rng.normal(0, noise, targets.center_offset.shape)
    predictions = predictions_of(targets._replace(center_offset=offset.astype("f4")))
    logits = np.zeros((1, len(owner), 2), "f4")
    logits[..., 1] = 4.0
    return points[None], predictions._replace(mask_logits=tf.constant(logits))


@pytest.mark.parametrize("noise", [0.0, 0.15])
def test_one_box_for_each_object(noise):
    points, predictions = scene(noise)
    (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig())
    assert found.boxes.shape == (2, 7)
    order = np.argsort(found.boxes[:, 0])
    np.testing.assert_allclose(found.boxes[order], BOXES, atol=1e-3 if noise == 0 else 0.15)
    np.testing.assert_array_equal(found.classes[order], [0, 1])
    assert np.all((found.scores > 0) & (found.scores <= 1))


def test_voting_beats_a_single_point():
    points, predictions = scene(0.25, per_object=200)
    (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig())
    error = np.linalg.norm(np.sort(found.boxes[:2, 0]) - np.sort(BOXES[:, 0]))
    single = np.abs(np.asarray(points[0, :200] + predictions.center_offset[0, :200])[:, 0] - 10)
    assert error < single.mean() / 2


def test_points_that_disagree_score_less():
    scores = []
    for noise in (0.05, 0.5):
        points, predictions = scene(noise)
        (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig(min_score=0.0))
        scores.append(found.scores[0])
    assert scores[1] < scores[0]


def test_no_foreground_gives_no_box():
    points, predictions = scene()
    background = tf.constant(np.tile(np.float32([4.0, -4.0]), (1, points.shape[1], 1)))
    predictions = predictions._replace(mask_logits=background)
    (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig())
    assert (found.boxes.shape, found.scores.shape) == ((0, 7), (0,))


def test_boxes_that_are_not_finite_are_left_out():
    points, predictions = scene()
    offset = predictions.center_offset.numpy()
    offset[0, :40] = np.nan
    predictions = predictions._replace(center_offset=tf.constant(offset))
    (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig())
    assert len(found.boxes) == 1
    assert np.isfinite(found.boxes).all()


def test_at_most_max_boxes():
    points, predictions = scene()
    (found,) = decode_detections(points, predictions, CONFIG, DecodingConfig(max_boxes=1))
    assert len(found.boxes) == 1


def test_vote_counts_headings_turned_round():
    boxes = np.array(
        [[0, 0, 0, 4, 2, 1.5, 0.1], [0, 0, 0, 4, 2, 1.5, 0.2], [0, 0, 0, 4, 2, 1.5, 0.15 - np.pi]]
    )
    assert _vote(boxes, np.ones(3), best=2)[6] == pytest.approx(0.15, abs=1e-6)


def test_rank_in_group():
    np.testing.assert_array_equal(_rank_in_group(np.array([5, 3, 5, 5, 3])), [0, 0, 1, 2, 1])
