"""Appearance vectors for DEEP_SORT: a geometric one from the points in a box, and its gallery.

The size of the box is not a feature: KITTI's labels have one size per object, so with ground-truth
boxes it would reveal the identity.
"""

from collections import deque

import numpy as np

from kitti.boxes import points_in_boxes, to_box_frame

BINS = 8  # slices of the box along each axis; our choice
EXTENT_SCALE = 5.0  # metres, about a car's length: extents weigh as much as one slice; our choice


def geometric_appearance(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Distribution of the points within each box.

    Args:
        points: (n, >=3) level frame, of the same frame as the boxes.
        boxes: (M, 7) level frame.

    Returns:
        (M, 27) float64, each row of unit length: shares of the points in 8 slices along the box's
        length, width and height, then the points' extents along them. A box without points has a
        row of zeros.
    """
    rows = [_shape_of(points, box) for box in np.asarray(boxes, np.float64)]
    return np.array(rows).reshape(-1, 3 * BINS + 3)


def _shape_of(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    inside = np.asarray(points[points_in_boxes(points, box[None]) >= 0, :3], np.float64)
    if len(inside) == 0:
        return np.zeros(3 * BINS + 3)
    local = to_box_frame(inside, box)
    shares = [
        np.histogram(axis / size, bins=BINS, range=(-0.5, 0.5))[0] / len(inside)
        for axis, size in zip(local.T, box[3:6], strict=True)
    ]
    return normalize(np.concatenate([*shares, np.ptp(local, axis=0) / EXTENT_SCALE]))


def normalize(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., C) at unit length; zero vectors stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


class Gallery:
    """The last `budget` appearance vectors of one track (Wojke et al. 2017, section II.B)."""

    def __init__(self, budget: int):
        self.vectors: deque[np.ndarray] = deque(maxlen=budget)

    def add(self, vector: np.ndarray) -> None:
        """Keeps a vector (C,) of unit length; ignores a zero vector."""
        if vector.any():
            self.vectors.append(vector)

    def distances(self, vectors: np.ndarray) -> np.ndarray:
        """Least cosine distance of each (M, C) to the gallery: (M,), NaN without vectors."""
        if not self.vectors:
            return np.full(len(vectors), np.nan)
        distance = 1.0 - (np.array(self.vectors) @ vectors.T).max(axis=0)
        return np.where(vectors.any(axis=1), distance, np.nan)
