"""Appearance vectors of DEEP_SORT: their gallery."""

from collections import deque

import numpy as np


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
        distances, known = np.full(len(vectors), np.nan), vectors.any(axis=1)
        if self.vectors and known.any():
            distances[known] = 1.0 - (np.array(self.vectors) @ vectors[known].T).max(axis=0)
        return distances
