"""The ground: a smooth height map through known heights, kerbs on top, and rays against it."""

import numpy as np

from simulator.bodies.convex import FAR
from simulator.world.grid import Grid, blur

SCALES = (60.0, 20.0, 7.0, 3.0)  # metres; heights are fitted from coarse to fine
COARSE_CELL, FINE_CELL = 2.0, 0.4  # metres


class Terrain:
    """Heights of the ground in the world frame.

    Args:
        samples: (n, 3) known points of the ground.
        weights: (n,) their weights.
        low, high: (2,) bounds of the map.
        kerb: height of all but the road (see `mark_road`) above it, metres.
    """

    def __init__(self, samples, weights, low, high, kerb: float = 0.12):
        self.base = _fit(Grid(low, high, COARSE_CELL), np.asarray(samples), np.asarray(weights))
        self.raised = Grid(low, high, FINE_CELL)
        self.raised.values[:] = kerb

    def mark_road(self, xy, height: float = 0.0) -> None:
        """Makes the cells of points (n, 2) road: `height` metres of crown instead of the kerb."""
        self.raised.mark(xy, height)

    def add_bumps(self, rng, amplitude: float, sigma: float) -> None:
        """Adds smooth random hills of `amplitude` metres (standard deviation)."""
        noise = blur(rng.normal(size=self.base.shape), sigma / COARSE_CELL)
        self.base.values += (noise * amplitude / max(noise.std(), 1e-9)).astype(np.float32)

    def height(self, xy) -> np.ndarray:
        """Heights at points (..., 2)."""
        return self.base.bilinear(xy) + self.raised.at(xy)

    def cast(self, columns) -> np.ndarray:
        """Horizontal distance (B, C) f32 at which rays meet the ground, FAR where they do not.

        `columns` is a `simulator.world.static.Columns`. Finds the first radial sample below the
        ground, then the crossing by four steps of false position.
        """
        radius = np.geomspace(1.2, 95.0, 100).astype(np.float32)
        xy = columns.origin[:, None] + columns.heading[:, None] * radius[None, :, None]
        ground = self.height(xy)  # (C, K)
        # A ray hits where it is not steeper upwards than the line of sight to the ground: the
        # first sample whose line of sight, or an earlier one's, reaches the ray's slope.
        beams, count = columns.slope.shape
        result = np.full((beams, count), FAR, np.float32)
        first = np.empty((beams, count), np.int64)
        lift = 1e3 * np.arange(count)  # makes one sorted row of all columns
        for height in np.unique(columns.height):
            rows = np.flatnonzero(columns.height == height)
            sight = np.maximum.accumulate((ground - height) / radius, axis=1).astype(np.float64)
            found = np.searchsorted(
                (sight + lift[:, None]).ravel(), columns.slope[rows] + lift, side="right"
            )
            first[rows] = found - np.arange(count) * len(radius)
        hit = (first > 0) & (first < len(radius))
        b, c = np.nonzero(hit)
        far, near = radius[first[b, c]], radius[first[b, c] - 1]
        slope, start = columns.slope[b, c], columns.height[b]
        origin, heading = columns.origin[c], columns.heading[c]

        def gap(distance):
            return start + slope * distance - self.height(origin + heading * distance[:, None])

        gap_near, gap_far = np.maximum(gap(near), 1e-4), np.minimum(gap(far), -1e-4)
        for _ in range(4):
            share = np.clip(gap_near / (gap_near - gap_far), 0.02, 0.98)
            middle = near + (far - near) * share
            value = gap(middle)
            above = value > 0
            near, gap_near = np.where(above, middle, near), np.where(above, value, gap_near)
            far, gap_far = np.where(above, far, middle), np.where(above, gap_far, value)
        share = gap_near / np.maximum(gap_near - gap_far, 1e-6)
        result[b, c] = near + (far - near) * share
        return result


def _fit(grid: Grid, samples, weights) -> Grid:
    """Fits the smooth map: at each scale the weighted mean of the residuals of coarser scales."""
    cells = grid.index(samples[:, :2])
    grid.values[:] = np.average(samples[:, 2], weights=weights)
    for scale in SCALES:
        sigma = scale / grid.cell
        rest = samples[:, 2] - grid.bilinear(samples[:, :2])
        total, mass = np.zeros(grid.shape), np.zeros(grid.shape)
        np.add.at(total, cells, weights * rest)
        np.add.at(mass, cells, weights)
        prior = 0.3 / (2 * np.pi * sigma**2)
        grid.values += (blur(total, sigma) / (blur(mass, sigma) + prior)).astype(np.float32)
    return grid
