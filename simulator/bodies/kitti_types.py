"""Sizes and bodies of objects by their KITTI type."""

import numpy as np

from simulator.bodies import people, vehicles
from simulator.bodies.convex import Body
from simulator.config import SIZES, SizeFit

BUILDERS = {
    "Car": vehicles.car,
    "Van": vehicles.van,
    "Truck": vehicles.truck,
    "Tram": vehicles.tram,
    "Misc": vehicles.misc,
    "Pedestrian": people.pedestrian,
    "Person": people.sitting,
    "Person_sitting": people.sitting,
    "Cyclist": people.cyclist,
}


def make_body(kind: str, size, seed: tuple[int, ...]) -> Body:
    """The body of a KITTI type (`Car`, `Van`, ...) for `size` (l, w, h) metres.

    Deterministic in the seed; unknown types are blocks on wheels (as `Misc`).
    """
    builder = BUILDERS.get(kind, vehicles.misc)
    return builder(size, np.random.default_rng(seed))


def draw_size(kind: str, rng) -> np.ndarray:
    """A random (l, w, h) in metres of a Car, Van, Truck, Pedestrian or Cyclist, as in `SIZES`."""
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
