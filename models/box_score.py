"""The score of a box: the probability that it is right at 3-D IoU 0.5 (a choice of ours).

A logistic regression on features of the cluster of proposals behind the box. Fitted by
`python -m training.calibrate` on labelled scans, it belongs to one detector and ships beside it.

Letters: K boxes (clusters), P proposals, N points, C channels of FC1, F features.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from kitti.boxes import box_corners, points_in_boxes
from models.box_decoding import Clusters

HDL64_STEP = np.deg2rad([0.17, 0.42])  # radians between returns, azimuth and elevation (mean)


def cluster_features(
    clusters: Clusters, points: np.ndarray, probability: np.ndarray
) -> dict[str, np.ndarray]:
    """What is known of each cluster, by name: each (K,) or (K, C) float64.

    Args:
        clusters: of one frame, K of them.
        points: (N, 3) float, level frame, metres: the points that the network saw.
        probability: (N,) their foreground probability.
    """
    if not len(clusters.boxes):
        raise ValueError("expected at least one cluster")
    features = {**_agreement(clusters), **_geometry(clusters, points, probability)}
    features |= _neighbours(clusters)
    proposals, voters = clusters.proposals, clusters.votes > 0
    if proposals.features is not None:
        fc1 = np.asarray(proposals.features, np.float64)
        features["FC1 mean"] = voters @ fc1 / voters.sum(-1, keepdims=True)
        features["FC1 maximum"] = np.array([fc1[row].max(0) for row in voters])
    if proposals.quality is not None:
        features |= _over_votes("quality", voters, np.asarray(proposals.quality, np.float64))
    return features


def _over_votes(name: str, voters: np.ndarray, values: np.ndarray) -> dict[str, np.ndarray]:
    """Mean and maximum of values (P,) over the voters (K, P) of each cluster."""
    return {
        f"{name} mean": voters @ values / voters.sum(-1),
        f"{name} maximum": np.where(voters, values, -np.inf).max(-1),
    }


def _agreement(clusters: Clusters) -> dict[str, np.ndarray]:
    votes, voters, members = clusters.votes, clusters.votes > 0, clusters.members
    probability = np.asarray(clusters.proposals.probability, np.float64)
    boxes = np.asarray(clusters.proposals.boxes, np.float64)
    share = votes / votes.sum(-1, keepdims=True)
    overlap = (share * clusters.iou).sum(-1)
    spread = share @ boxes[:, :6] ** 2 - (share @ boxes[:, :6]) ** 2
    turn = share @ np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])], -1)
    return {
        "proposals": np.log1p(members.sum(-1)),
        "votes": np.log1p(voters.sum(-1)),
        "support": np.log1p(votes.sum(-1)),
        "share of votes": voters.sum(-1) / members.sum(-1),
        "agreement": logit(np.clip(clusters.agreement, 0.01, 0.99)),
        "IoU": overlap,
        "IoU deviation": np.sqrt(np.maximum((share * clusters.iou**2).sum(-1) - overlap**2, 0)),
        **_over_votes("probability", voters, probability),
        "centre deviation": np.log(0.05 + np.sqrt(np.maximum(spread[:, :3].sum(-1), 0))),
        "size deviation": np.log(0.05 + np.sqrt(np.maximum(spread[:, 3:].sum(-1), 0))),
        "heading": np.hypot(*turn.T),
        "class": clusters.classes[:, 0].astype(np.float64),
    }


def _geometry(clusters: Clusters, points: np.ndarray, probability: np.ndarray):
    boxes = np.asarray(clusters.boxes, np.float64)
    owner = points_in_boxes(points, boxes)
    held = owner >= 0
    inside = np.bincount(owner[held], minlength=len(boxes)).astype(np.float64)
    likely = np.bincount(owner[held], probability[held], len(boxes))
    distance = np.maximum(np.hypot(boxes[:, 0], boxes[:, 1]), 1.0)
    corners = box_corners(boxes)[:, :4]
    azimuth = np.arctan2(corners[..., 1], np.maximum(corners[..., 0], 0.1))
    low, high = np.quantile(np.arctan2(points[:, 1], np.maximum(points[:, 0], 0.1)), [0.002, 0.998])
    width = azimuth.max(-1) - azimuth.min(-1)
    cut = np.maximum(low - azimuth.min(-1), 0) + np.maximum(azimuth.max(-1) - high, 0)
    expected = width * (boxes[:, 5] / distance) / HDL64_STEP.prod()
    size = np.log(boxes[:, 3:6])
    return {
        "points": np.log1p(inside),
        "points over expected": np.log1p(inside) - np.log1p(expected),
        "foreground inside": likely / np.maximum(inside, 1.0),
        "range": distance / 50.0,
        "range squared": (distance / 50.0) ** 2,
        "log range": np.log(distance),
        "length": size[:, 0],
        "width": size[:, 1],
        "height": size[:, 2],
        "bottom": boxes[:, 2] - boxes[:, 5] / 2,
        "truncation": np.minimum(cut / np.maximum(width, 1e-3), 1.0),
        "side": np.abs(np.arctan2(boxes[:, 1], np.maximum(boxes[:, 0], 0.1))),
    }


def _neighbours(clusters: Clusters) -> dict[str, np.ndarray]:
    """The nearest better supported box: how near, and how much more support it has."""
    centres, support = clusters.boxes[:, :2].astype(np.float64), clusters.votes.sum(-1)
    gap = np.linalg.norm(centres[:, None] - centres, axis=-1)
    gap = np.where(support > support[:, None], gap, np.inf)
    nearest = gap.argmin(-1)
    near = np.exp(-gap.min(-1) / 2.0)
    return {
        "near a better one": near,
        "much better one": near * np.log((1 + support[nearest]) / (1 + support)),
    }


def stack(features: dict[str, np.ndarray]) -> np.ndarray:
    """Features by name -> (K, F) float64, in their order."""
    return np.concatenate([np.reshape(x, (len(x), -1)) for x in features.values()], -1)


@dataclass(frozen=True)
class BoxScorer:
    """Logistic regression on standardised features."""

    names: tuple[str, ...]  # of the features, in order
    mean: np.ndarray  # (F,)
    scale: np.ndarray  # (F,)
    weight: np.ndarray  # (F,) of standardised features
    bias: float
    min_score: float  # the default threshold of a box that is kept

    def scores(self, features: np.ndarray) -> np.ndarray:
        """(K, F) -> (K,) probabilities."""
        return expit((features - self.mean) / self.scale @ self.weight + self.bias)
