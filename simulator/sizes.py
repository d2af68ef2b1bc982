"""Random sizes of objects, as KITTI's labels have them."""

from __future__ import annotations

import numpy as np

from simulator.config import SIZES, SizeFit


def draw_size(kind: str, rng) -> np.ndarray:
    """(l, w, h) in metres of a Car, Van, Truck, Pedestrian or Cyclist."""
    fit: SizeFit = getattr(SIZES, kind.lower())
    correlation = np.eye(3)
    for (i, j), value in (
        ((0, 1), fit.correlation_lw),
        ((0, 2), fit.correlation_lh),
        ((1, 2), fit.correlation_wh),
    ):
        correlation[i, j] = correlation[j, i] = value
    covariance = correlation * np.outer(fit.std, fit.std)
    for _ in range(100):
        size = rng.multivariate_normal(fit.mean, covariance)
        if (size >= fit.low).all() and (size <= fit.high).all():
            return size
    return np.asarray(fit.mean)
