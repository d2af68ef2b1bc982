"""Scans of a street from a car that drives along it, in any order of the axes."""

import numpy as np

TURNS = {"x": ([0, 1], [1, 1]), "-x": ([0, 1], [-1, -1]), "y": ([1, 0], [-1, 1])}
TURNS["-y"] = ([1, 0], [1, -1])


def drive(travelled: float) -> np.ndarray:
    """(n, 3) points of a street: road, walls along it, and poles, after `travelled` metres."""
    rng = np.random.default_rng(0)
    road = np.column_stack([rng.uniform(-25, 25, (9000, 2)), rng.normal(-1.7, 0.02, 9000)])
    x = np.repeat(np.arange(-60, 60, 0.1), 3)
    wall = np.column_stack([x, np.full(len(x), 7.0), rng.uniform(-1, 1, len(x))])
    spots = rng.uniform((-60, -12), (60, 12), (150, 2)).repeat(30, 0)
    poles = np.column_stack([spots, rng.uniform(-1, 1, len(spots))])
    standing = np.concatenate([wall, wall * [1, -1, 1], poles]) - [travelled, 0, 0]
    return np.concatenate([road, standing])


def as_seen(points: np.ndarray, ahead: str) -> np.ndarray:
    """The scan of a scanner whose axis `ahead` points ahead, z up."""
    order, signs = TURNS[ahead]
    return np.column_stack([points[:, order] * signs, points[:, 2]])
