"""From points to boxes: one box for each object, and nothing from nothing."""

import numpy as np
import pytest
import tensorflow as tf
from test_box_coding import predictions_of

from models.boxes.box_coding import encode_boxes
from models.boxes.box_decoding import (
    Proposals,
    _rank_in_group,
    _thin,
    _vote,
    cluster,
    decode_detections,
)
from models.config import BoxCodingConfig, DecodingConfig
from tf_ops import box_iou_3d

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
    voted = _vote(boxes, np.full((1, 3), 1 / 3), np.array([2]))
    assert voted[0, 6] == pytest.approx(0.15, abs=1e-6)


def test_rank_in_group():
    np.testing.assert_array_equal(_rank_in_group(np.array([5, 3, 5, 5, 3])), [0, 0, 1, 2, 1])


def proposals_at_random(count=300, objects=12, quality=False, seed=0):
    """Boxes scattered around a few objects, some of them far off."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform((5, -15, -1, 3.5, 1.5, 1.4, -3), (50, 15, 0, 5, 2, 2, 3), (objects, 7))
    boxes = centers[rng.integers(0, objects, count)]
    boxes = boxes + rng.normal(0, 1, boxes.shape) * (0.5, 0.5, 0.2, 0.3, 0.1, 0.1, 0.2)
    classes = rng.dirichlet((1, 1), count)
    values = (boxes, rng.uniform(0.4, 1, count), classes, rng.normal(0, 1, (count, 5)))
    likely = rng.uniform(0.2, 1, count).astype("f4") if quality else None
    return Proposals(*(x.astype("f4") for x in values), likely)


def thin_one_by_one(proposals, config):
    """Reference: rows that stay, the most probable of each cell first, then the second ones..."""
    cells, ranked = {}, []
    for row in sorted(range(len(proposals.boxes)), key=lambda row: -proposals.probability[row]):
        if np.isfinite(proposals.boxes[row]).all():
            cell = tuple(np.floor(proposals.boxes[row, :2] / config.cell))
            cells[cell] = cells.get(cell, -1) + 1
            ranked.append((cells[cell], row))
    ranked.sort(key=lambda item: item[0])
    rows = [row for rank, row in ranked if rank < config.proposals_per_cell]
    return rows[: config.max_proposals]


def clusters_one_by_one(proposals, config):
    """Reference: boxes, agreements, members and votes of the clusters, one after the other."""
    boxes = proposals.boxes
    iou = box_iou_3d(boxes, boxes).numpy()
    overlap = np.where(iou >= config.vote_iou, iou, 0.0) * proposals.probability
    votes = overlap if proposals.quality is None else overlap * proposals.quality
    support, alive, found = votes.sum(-1), np.ones(len(boxes), bool), []
    while alive.any() and len(found) < config.max_boxes:
        best = int(np.argmax(np.where(alive, support, -1.0)))
        members = alive & (iou[best] > config.nms_iou)
        members[best] = True
        weights = votes[best] * members
        weights[best] = max(weights[best], 1e-6)
        share = weights / weights.sum()
        turn = np.cos(boxes[:, 6] - boxes[best, 6])
        forward = share[turn >= 0].sum() >= 0.5
        yaw = boxes[:, 6] + np.where((turn >= 0) == forward, 0.0, np.pi)
        yaw = np.arctan2(share @ np.sin(yaw), share @ np.cos(yaw))
        agreement = overlap[best][members].sum() / (np.count_nonzero(members) + config.score_prior)
        found.append(([*(share @ boxes[:, :6]), yaw], agreement, members, weights))
        alive &= ~members
    return [np.array(part) for part in zip(*found, strict=True)]


def expect_same_clusters(found, expected):
    """found, of `cluster`, has the members of the reference, and its values up to rounding."""
    boxes, agreement, members, votes = expected
    np.testing.assert_array_equal(found.members, members)
    np.testing.assert_allclose(found.votes, votes, rtol=1e-5)
    np.testing.assert_allclose(found.boxes, boxes, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(found.agreement, agreement, rtol=1e-4)


@pytest.mark.parametrize("quality", [False, True])
@pytest.mark.parametrize("max_boxes", [3, 64])
def test_clusters_equal_those_found_one_by_one(quality, max_boxes):
    config = DecodingConfig(max_boxes=max_boxes)
    proposals = proposals_at_random(quality=quality)
    expected = clusters_one_by_one(_thin(proposals, config), config)
    expect_same_clusters(cluster(proposals, config), expected)


def hostile_proposals(case):
    """Proposals that leave the decoding little to decide by."""
    proposals = proposals_at_random(1500, objects=40, quality=True)
    boxes = proposals.boxes.copy()
    if case == "one":
        return Proposals(*(x[:1] for x in proposals))
    if case == "all identical":
        boxes[:] = boxes[0]
    if case == "one cell":
        boxes[:, :2] = boxes[0, :2] // 0.5 * 0.5 + 0.1
    if case == "without size":
        boxes[::2, 3:6] = 0
    if case == "not finite":
        boxes[::3, 6] = np.nan
    return proposals._replace(boxes=boxes)


@pytest.mark.parametrize(
    "case", ["one", "all identical", "one cell", "without size", "not finite", "too many"]
)
def test_hostile_proposals(case):
    """The rows that stay and their clusters equal those of the reference."""
    config, proposals = DecodingConfig(), hostile_proposals(case)
    rows = thin_one_by_one(proposals, config)
    assert len(rows) == {"one": 1, "all identical": 40, "one cell": 40}.get(case, 600)
    thinned = Proposals(*(x[rows] for x in proposals))
    found = cluster(proposals, config)
    for one, other in zip(found.proposals, thinned, strict=True):
        np.testing.assert_array_equal(one, other)
    expect_same_clusters(found, clusters_one_by_one(thinned, config))


def test_every_proposal_votes_in_one_cluster_at_most():
    config = DecodingConfig()
    found = cluster(proposals_at_random(), config)
    assert found.members.sum(0).max() == 1
    np.testing.assert_array_equal(found.votes > 0, found.members & (found.iou >= config.vote_iou))
    np.testing.assert_allclose(found.classes.sum(-1), 1, rtol=1e-5)


def test_quality_moves_the_box_to_the_better_proposals():
    """Two equally likely boxes, 0.4 m apart: the mean lies nearer to the better one."""
    boxes = np.float32([[10, 0, 0, 4, 2, 1.5, 0], [10.4, 0, 0, 4, 2, 1.5, 0]])
    likely, classes = np.float32([0.9, 0.9]), np.float32([[1, 0], [1, 0]])
    quality = np.float32([0.9, 0.3])
    plain = cluster(Proposals(boxes, likely, classes), DecodingConfig())
    weighed = cluster(Proposals(boxes, likely, classes, None, quality), DecodingConfig())
    assert abs(weighed.boxes[0, 0] - 10) < abs(plain.boxes[0, 0] - 10)
    assert weighed.agreement[0] == plain.agreement[0]


def test_no_proposals_give_no_cluster():
    none = Proposals(np.zeros((0, 7), "f4"), np.zeros(0, "f4"), np.zeros((0, 2), "f4"))
    found = cluster(none, DecodingConfig())
    assert (found.boxes.shape, found.agreement.shape) == ((0, 7), (0,))
