"""Overlap of upright boxes in the image: x1, y1, x2, y2 in pixels."""

from __future__ import annotations

import numpy as np

EPS = np.finfo(np.float64).eps


def intersection(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Areas shared by boxes (M, 4) and (K, 4): (M, K) square pixels."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    return np.prod(np.maximum(high - low, 0.0), axis=-1)


def area(boxes: np.ndarray) -> np.ndarray:
    """Areas (M,) of boxes (M, 4), square pixels."""
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])


def iou_2d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union (M, K); 0 where either box is empty."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    shared, area_a, area_b = intersection(a, b), area(a), area(b)
    union = area_a[:, None] + area_b[None, :] - shared
    valid = (area_a > EPS)[:, None] & (area_b > EPS)[None, :] & (union > EPS)
    return np.where(valid, shared, 0.0) / np.where(valid, union, 1.0)


def covered(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Share (M, K) of the area of each of `a` that lies in each of `b`; 0 for an empty box."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    area_a = area(a)[:, None]
    return np.where(area_a > EPS, intersection(a, b), 0.0) / np.where(area_a > EPS, area_a, 1.0)
