"""From per-point predictions to M boxes with scores: non-maximum suppression with box voting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import tensorflow as tf

from models.box_coding import decode_boxes
from models.config import BoxCodingConfig, note
from models.probability_filter import foreground_probability
from tf_ops import box_iou_3d


@dataclass(frozen=True)
class DecodingConfig:
    """How boxes are made from points.

    Chosen on simulated scans of sequence 0011, which is held out of training:
    docs/tables/decoding_parameters.md (experiments/decoding_parameters.py).
    """

    min_probability: float = note(0.4, "foreground probability of a point that proposes a box")
    cell: float = note(0.5, "metres; proposals are thinned by the cell of their centre")
    proposals_per_cell: int = note(40, "the most probable ones of each cell stay")
    max_proposals: int = note(600, "of a frame")
    nms_iou: float = note(0.02, "boxes that overlap more belong to the same object")
    vote_iou: float = note(0.4, "proposals that overlap more are averaged (box voting)")
    doubt: float = note(4.0, "proposals against every box, so that lonely ones score less")
    min_score: float = note(0.3, "of a box that is kept")
    max_boxes: int = note(64, "M")


class Detections(NamedTuple):
    """The boxes of one frame, best first."""

    boxes: np.ndarray  # (M, 7) float32 level frame
    scores: np.ndarray  # (M,) float32 in [0, 1]
    classes: np.ndarray  # (M,) int32


class Proposals(NamedTuple):
    """The boxes of the points of one frame that may be foreground."""

    boxes: tf.Tensor  # (P, 7) float32 level frame
    probability: tf.Tensor  # (P,) float32, foreground
    classes: tf.Tensor  # (P, NC) float32, probabilities


def propose(query_xyz, predictions, box: BoxCodingConfig, min_probability: float) -> Proposals:
    """(Q, ...) predictions at query_xyz (Q, 3), one frame -> Proposals; few boxes are decoded."""
    probability = foreground_probability(predictions.mask_logits)
    rows = tf.where(probability >= min_probability)[:, 0]
    xyz, likely = tf.nest.map_structure(lambda x: tf.gather(x, rows), (query_xyz, predictions))
    boxes = decode_boxes(*tf.nest.map_structure(lambda x: x[tf.newaxis], (xyz, likely)), box)[0]
    return Proposals(boxes, tf.gather(probability, rows), tf.nn.softmax(likely.class_scores))


def select(proposals: Proposals, config: DecodingConfig) -> Detections:
    """The boxes that many proposals agree on.

    The score of a box is the mean of foreground probability * IoU with it over the proposals
    that it stands for and `doubt` more that say nothing, so boxes on which many points agree come
    first.
    """
    return _suppress(*_thin(*(x.numpy() for x in proposals), config), config)


def decode_detections(
    query_xyz, predictions, box: BoxCodingConfig, config: DecodingConfig
) -> list[Detections]:
    """(B, Q, ...) predictions at query_xyz (B, Q, 3) -> Detections of each of the B frames."""
    found = []
    for b in range(len(query_xyz)):
        xyz, frame = tf.nest.map_structure(
            lambda x, b=b: tf.convert_to_tensor(x[b]), (query_xyz, predictions)
        )
        found.append(select(propose(xyz, frame, box, config.min_probability), config))
    return found


def _thin(boxes, probability, classes, config: DecodingConfig):
    """Thins the boxes of a frame, (P, 7), (P,), (P, NC), cell by cell."""
    rows = np.flatnonzero(np.all(np.isfinite(boxes), -1))
    rows = rows[np.argsort(-probability[rows], kind="stable")]
    cells = np.floor(boxes[rows, :2] / config.cell).astype(np.int64)
    rank = _rank_in_group(cells[:, 0] * 1_000_003 + cells[:, 1])
    order = np.argsort(rank, kind="stable")  # every cell's most probable first
    rows = rows[order[rank[order] < config.proposals_per_cell]][: config.max_proposals]
    return boxes[rows], probability[rows], classes[rows]


def _rank_in_group(keys: np.ndarray) -> np.ndarray:
    """How many earlier entries of keys (n,) are equal, for each: (n,) int64."""
    order = np.argsort(keys, kind="stable")
    first = np.searchsorted(keys[order], keys[order], side="left")
    rank = np.empty(len(keys), np.int64)
    rank[order] = np.arange(len(keys)) - first
    return rank


def _suppress(boxes, probability, classes, config: DecodingConfig) -> Detections:
    """Greedy suppression by support; the kept box is the mean of those that vote for it."""
    if not len(boxes):
        return Detections(
            np.zeros((0, 7), np.float32), np.zeros(0, np.float32), np.zeros(0, np.int32)
        )
    iou = box_iou_3d(boxes, boxes).numpy()
    votes = np.where(iou >= config.vote_iou, iou, 0.0) * probability
    support = votes.sum(-1)
    alive, kept, scores, labels = np.ones(len(boxes), bool), [], [], []
    while alive.any() and len(kept) < config.max_boxes:
        best = int(np.argmax(np.where(alive, support, -1.0)))
        weights = votes[best] * alive
        weights[best] = max(weights[best], 1e-6)
        cluster = alive & (iou[best] > config.nms_iou)
        kept.append(_vote(boxes, weights, best))
        scores.append(weights.sum() / (np.count_nonzero(cluster) + config.doubt))
        labels.append(int((classes * weights[:, None]).sum(0).argmax()))
        alive &= ~cluster
        alive[best] = False
    order = np.argsort(-np.array(scores), kind="stable")
    order = order[np.array(scores)[order] >= config.min_score]
    return Detections(
        np.array(kept, np.float32)[order],
        np.array(scores, np.float32)[order],
        np.array(labels, np.int32)[order],
    )


def _vote(boxes: np.ndarray, weights: np.ndarray, best: int) -> np.ndarray:
    """The weighted mean box; headings opposite to the majority count turned round."""
    share = weights / weights.sum()
    mean = share @ boxes[:, :6]
    turn = np.cos(boxes[:, 6] - boxes[best, 6])
    forward = share[turn >= 0].sum() >= 0.5
    yaw = boxes[:, 6] + np.where((turn >= 0) == forward, 0.0, np.pi)
    yaw = np.arctan2(share @ np.sin(yaw), share @ np.cos(yaw))
    return np.append(mean, yaw if yaw < np.pi else -np.pi)
