"""Which body stands for which KITTI type."""

from __future__ import annotations

import numpy as np

from simulator import people, vehicles
from simulator.convex import Body

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

    The same seed gives the same body; unknown types are blocks on wheels (as `Misc`).
    """
    builder = BUILDERS.get(kind, vehicles.misc)
    return builder(size, np.random.default_rng(seed))
