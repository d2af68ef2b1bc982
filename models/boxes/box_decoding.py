"""Decodes per-point predictions to M boxes with scores: non-maximum suppression with box voting.

Letters: P proposals (boxes of single points), K clusters of proposals, NC classes.
"""

from typing import NamedTuple

import numpy as np
import tensorflow as tf

from models.boxes.box_coding import decode_boxes
from models.config import BoxCodingConfig, DecodingConfig
from models.probability_filter import foreground_probability
from tf_ops import suppress_boxes


class Detections(NamedTuple):
    """The boxes of one frame, best first."""

    boxes: np.ndarray  # (M, 7) float32 level frame
    scores: np.ndarray  # (M,) float32 in [0, 1]
    classes: np.ndarray  # (M,) int32 index into the classes of BoxCodingConfig


class Proposals(NamedTuple):
    """The boxes of the points of one frame that may be foreground."""

    boxes: tf.Tensor  # (P, 7) float32 level frame
    probability: tf.Tensor  # (P,) float32, foreground
    classes: tf.Tensor  # (P, NC) float32, probabilities
    features: tf.Tensor | None = None  # (P, C) float32, FC1 of the detector
    quality: tf.Tensor | None = None  # (P,) float32, predicted IoU of the box in [0, 1]


class Clusters(NamedTuple):
    """Proposals of one frame grouped into K boxes, most supported first, without final scores."""

    boxes: np.ndarray  # (K, 7) float32 level frame: the mean of the votes
    agreement: np.ndarray  # (K,) float32 in [0, 1]: see `cluster`
    classes: np.ndarray  # (K, NC) float32: mean class probabilities of the votes
    iou: np.ndarray  # (K, P) float32: IoU of the best supported proposal with every proposal
    members: np.ndarray  # (K, P) bool: the proposals of each cluster
    votes: np.ndarray  # (K, P) float32: weight of each proposal in the mean, 0 without a vote
    proposals: Proposals  # of P rows, as NumPy arrays, after thinning


def propose(
    query_xyz, predictions, box: BoxCodingConfig, min_probability: float, fc1=None
) -> Proposals:
    """(Q, ...) predictions at query_xyz (Q, 3), one frame -> Proposals; few boxes are decoded.

    The features fc1 (Q, C) are gathered where they are given.
    """
    probability = foreground_probability(predictions.mask_logits)
    rows = tf.where(probability >= min_probability)[:, 0]
    xyz, likely = tf.nest.map_structure(lambda x: tf.gather(x, rows), (query_xyz, predictions))
    boxes = decode_boxes(*tf.nest.map_structure(lambda x: x[tf.newaxis], (xyz, likely)), box)[0]
    quality = likely.quality_logits
    return Proposals(
        boxes,
        tf.gather(probability, rows),
        tf.nn.softmax(likely.class_scores),
        None if fc1 is None else tf.gather(fc1, rows),
        tf.sigmoid(quality[:, 0]) if quality.shape[-1] else None,
    )


def decode_detections(
    query_xyz, predictions, box: BoxCodingConfig, config: DecodingConfig
) -> list[Detections]:
    """(B, Q, ...) predictions at query_xyz (B, Q, 3) -> Detections of each of the B frames.

    Scored by agreement.
    """
    found = []
    for b in range(len(query_xyz)):
        xyz, frame = tf.nest.map_structure(
            lambda x, b=b: tf.convert_to_tensor(x[b]), (query_xyz, predictions)
        )
        clusters = cluster(propose(xyz, frame, box, config.min_probability), config)
        found.append(best_first(clusters, clusters.agreement, config.min_score))
    return found


def cluster(proposals: Proposals, config: DecodingConfig) -> Clusters:
    """Greedy suppression by support; each kept box is the mean of those that vote for it.

    A proposal votes for those that it overlaps by `vote_iou`, with its foreground probability * IoU
    * quality, where there is one; their sum is the support. The agreement of a cluster is the mean
    of probability * IoU over its members and `score_prior` further zeros, so boxes on which many
    points agree come first.
    """
    thinned = _thin(Proposals(*(None if x is None else np.asarray(x) for x in proposals)), config)
    boxes = thinned.boxes
    if not len(boxes):
        none = np.zeros((0, 0), np.float32)
        nothing = (boxes, thinned.probability, thinned.classes)
        return Clusters(*nothing, none, none.astype(bool), none, thinned)
    quality = np.float32(1) if thinned.quality is None else thinned.quality
    suppressed = suppress_boxes(
        boxes,
        thinned.probability * quality,
        vote_iou=config.vote_iou,
        nms_iou=config.nms_iou,
        max_boxes=config.max_boxes,
    )
    kept, owner, iou = (x.numpy() for x in suppressed)
    members = owner == np.arange(len(kept))[:, None]
    overlap = np.where(iou >= config.vote_iou, iou, 0.0) * thinned.probability * members
    votes = overlap * quality
    own = np.arange(len(kept)), kept
    votes[own] = np.maximum(votes[own], 1e-6)
    share = votes / votes.sum(-1, keepdims=True)
    agreement = overlap.sum(-1) / (members.sum(-1) + config.score_prior)
    return Clusters(
        _vote(boxes, share, kept),
        agreement.astype(np.float32),
        share @ thinned.classes,
        iou,
        members,
        votes,
        thinned,
    )


def best_first(clusters: Clusters, scores: np.ndarray, min_score: float) -> Detections:
    """The boxes of the clusters whose score (K,) is at least min_score, best first."""
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] >= min_score]
    return Detections(
        clusters.boxes[order],
        scores[order].astype(np.float32),
        clusters.classes.argmax(-1)[order].astype(np.int32),
    )


def _thin(proposals: Proposals, config: DecodingConfig) -> Proposals:
    """Keeps the most probable proposals of every cell, at most max_proposals in all."""
    rows = np.flatnonzero(np.all(np.isfinite(proposals.boxes), -1))
    rows = rows[np.argsort(-proposals.probability[rows], kind="stable")]
    cells = np.floor(proposals.boxes[rows, :2] / config.cell).astype(np.int64)
    rank = _rank_in_group(cells[:, 0] * 1_000_003 + cells[:, 1])
    few = np.flatnonzero(rank < config.proposals_per_cell)
    order = few[np.argsort(rank[few], kind="stable")]  # every cell's most probable first
    rows = rows[order[: config.max_proposals]]
    return Proposals(*(None if x is None else x[rows] for x in proposals))


def _rank_in_group(keys: np.ndarray) -> np.ndarray:
    """Number of earlier entries of keys (n,) that equal each entry: (n,) int64."""
    order = np.argsort(keys, kind="stable")
    first = np.searchsorted(keys[order], keys[order], side="left")
    rank = np.empty(len(keys), np.int64)
    rank[order] = np.arange(len(keys)) - first
    return rank


def _vote(boxes: np.ndarray, share: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Weighted mean boxes (K, 7) float32; headings opposite to the majority are reversed.

    boxes (P, 7), share (K, P) of rows that sum to 1, kept (K,) rows of the best supported boxes.
    """
    mean = share @ boxes[:, :6]
    ahead = np.cos(boxes[:, 6] - boxes[kept, 6, None]) >= 0
    forward = (share * ahead).sum(-1, keepdims=True) >= 0.5
    sign = np.where(ahead == forward, share, -share)
    yaw = np.arctan2(sign @ np.sin(boxes[:, 6]), sign @ np.cos(boxes[:, 6]))
    yaw = np.where(yaw < np.pi, yaw, -np.pi)
    return np.concatenate([mean, yaw[:, None]], -1).astype(np.float32)
