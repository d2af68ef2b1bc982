"""Features of a cluster of proposals, from which the score of its box is computed.

Letters: K clusters, P proposals, N points, C channels of FC1, F features.
"""

from collections.abc import Sequence

import numpy as np

from kitti.boxes import box_corners, points_in_boxes
from models.boxes.box_decoding import Clusters

HDL64_STEP = np.deg2rad([0.17, 0.42])  # radians between returns, azimuth and elevation (mean)
VIEW = (0.002, 0.998)  # quantiles of the points' azimuths that bound the view
FC1 = "FC1"  # begins the names of features from a channel of FC1
NEAR = 2.0  # metres; scale of the distance to a better supported box


def cluster_features(
    clusters: Clusters, points: np.ndarray, probability: np.ndarray
) -> dict[str, np.ndarray]:
    """Features of each cluster by name, (K,) float64; counts and sizes as logarithms.

    Args:
        clusters: of one frame, K >= 1 of them.
        points: (N, 3) float, level frame, metres: the input points of the detector.
        probability: (N,) their foreground probability.

    Returns:
        Agreement of the proposals, geometry, better supported neighbours; where the proposals have
        them, also mean and maximum over the voters of their quality and of each channel of FC1.
    """
    features = {**_agreement(clusters), **_geometry(clusters, points, probability)}
    features |= _neighbours(clusters)
    proposals, voters = clusters.proposals, clusters.votes > 0
    if proposals.quality is not None:
        features |= _over_votes(["quality"], voters, proposals.quality[:, None])
    if proposals.features is not None:
        names = [f"{FC1} {channel}" for channel in range(proposals.features.shape[1])]
        features |= _over_votes(names, voters, proposals.features)
    return features


def _over_votes(
    names: Sequence[str], voters: np.ndarray, values: np.ndarray
) -> dict[str, np.ndarray]:
    """Mean and maximum of the columns of values (P, C) over the voters (K, P) of each cluster."""
    chosen = [values[rows] for rows in voters]
    mean = np.stack([rows.mean(0, dtype=np.float64) for rows in chosen])
    maximum = np.stack([rows.max(0) for rows in chosen]).astype(np.float64)
    return {
        **dict(zip([f"{name} mean" for name in names], mean.T, strict=True)),
        **dict(zip([f"{name} maximum" for name in names], maximum.T, strict=True)),
    }


def _agreement(clusters: Clusters) -> dict[str, np.ndarray]:
    """Number, probability and agreement of the proposals of each cluster."""
    votes, voters, members = clusters.votes, clusters.votes > 0, clusters.members
    probability = np.asarray(clusters.proposals.probability, np.float64)
    boxes = np.asarray(clusters.proposals.boxes, np.float64)
    agreement = np.clip(clusters.agreement, 0.01, 0.99)
    share = votes / votes.sum(-1, keepdims=True)
    overlap = (share * clusters.iou).sum(-1)
    spread = share @ boxes[:, :6] ** 2 - (share @ boxes[:, :6]) ** 2
    turn = share @ np.stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])], -1)
    return {
        "proposals": np.log1p(members.sum(-1)),
        "votes": np.log1p(voters.sum(-1)),
        "support": np.log1p(votes.sum(-1)),
        "share of votes": voters.sum(-1) / members.sum(-1),
        "agreement": np.log(agreement / (1 - agreement)),
        "IoU": overlap,
        "IoU deviation": np.sqrt(np.maximum((share * clusters.iou**2).sum(-1) - overlap**2, 0)),
        **_over_votes(["probability"], voters, probability[:, None]),
        "centre deviation": np.log(0.05 + np.sqrt(np.maximum(spread[:, :3].sum(-1), 0))),
        "size deviation": np.log(0.05 + np.sqrt(np.maximum(spread[:, 3:].sum(-1), 0))),
        "heading": np.hypot(*turn.T),
        "class": clusters.classes[:, 0].astype(np.float64),
    }


def _geometry(
    clusters: Clusters, points: np.ndarray, probability: np.ndarray
) -> dict[str, np.ndarray]:
    """Range, size and place of the box, its points, and the number expected at its range.

    Expected are the returns of an HDL-64E over the width and height at which the box is seen.
    Truncation is the share of that width beyond the edges of the view.
    """
    boxes = np.asarray(clusters.boxes, np.float64)
    owner = points_in_boxes(points, boxes)
    held = owner >= 0
    inside = np.bincount(owner[held], minlength=len(boxes)).astype(np.float64)
    likely = np.bincount(owner[held], probability[held], len(boxes))
    distance = np.maximum(np.hypot(boxes[:, 0], boxes[:, 1]), 1.0)
    corners = box_corners(boxes)[:, :4]
    azimuth = np.arctan2(corners[..., 1], np.maximum(corners[..., 0], 0.1))
    low, high = _view(points)
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


def _view(points: np.ndarray) -> np.ndarray:
    """The quantiles VIEW of the azimuths of points (N, 3) ahead, radians, (2,) float64.

    Equals np.quantile, but partitions the slopes, which have the order of the angles.
    """
    slope = points[:, 1] / np.maximum(points[:, 0], 0.1)
    places = np.array(VIEW) * (len(slope) - 1)
    below = np.floor(places).astype(int)
    above = np.minimum(below + 1, len(slope) - 1)
    ordered = np.partition(slope, np.union1d(below, above))
    first, second = (np.arctan(ordered[at].astype(np.float64)) for at in (below, above))
    return first + (places - below) * (second - first)


def _neighbours(clusters: Clusters) -> dict[str, np.ndarray]:
    """Distance and support of the nearest better supported box."""
    centres, support = clusters.boxes[:, :2].astype(np.float64), clusters.votes.sum(-1)
    gap = np.linalg.norm(centres[:, None] - centres, axis=-1)
    gap = np.where(support > support[:, None], gap, np.inf)
    nearest = gap.argmin(-1)
    near = np.exp(-gap.min(-1) / NEAR)
    return {
        "near a better one": near,
        "much better one": near * np.log((1 + support[nearest]) / (1 + support)),
    }
