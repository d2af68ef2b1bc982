"""Ground points by a fitted surface: a robust quadratic plus a smooth local correction.

1. The scan is cut into square cells; each gives a low percentile of its heights.
2. A quadratic in x, y (slope, crown, the bend of a hill) is fitted by reweighted least squares;
   cells above the surface (cars, walls, trees) lose their weight sooner than cells below.
3. What is left over in the cells near the surface is smoothed over their neighbourhood and added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GroundConfig:
    """All choices are ours: the paper says only that ground points are extracted first."""

    cell_m: float = 2.0  # smaller than a car's footprint is long, larger than the ring spacing
    percentile: float = 10.0  # low, but not the lowest point: reflections lie below the road
    min_points: int = 3  # a cell with fewer says nothing about its lower envelope
    iterations: int = 12
    scale_m: float = 0.15  # cells within this of the surface count fully
    start_scale_m: float = 1.2  # the scale of the first iteration; it shrinks to scale_m
    above_penalty: float = 3.0  # how much sooner cells above the surface lose weight
    smooth_m: float = 4.0  # standard deviation of the local correction's neighbourhood
    prior_weight: float = 2.0  # cells' worth of zero correction; keeps lonely cells calm
    threshold_m: float = 0.2  # above the surface: roughness and range noise; wheels start lower


GROUND = GroundConfig()


@dataclass(frozen=True, eq=False)
class GroundModel:
    """Height of the ground over the level plane.

    Attributes:
        coefficients: (6,) of 1, x, y, x^2, x y, y^2, in units of `span` metres.
        span: metres by which x and y are divided.
        origin: (2,) metres, centre of cell (0, 0) of the correction.
        cell_m: edge of a cell.
        correction: (A, B) metres added at cell centres, bilinear between, constant outside.
    """

    coefficients: np.ndarray
    span: float
    origin: np.ndarray
    cell_m: float
    correction: np.ndarray

    def height(self, xy: np.ndarray) -> np.ndarray:
        """(n, >= 2) level x, y in metres -> (n,) float64 z of the ground."""
        xy = np.asarray(xy, np.float64)[:, :2]
        at = (xy - self.origin) / self.cell_m
        return _basis(xy, self.span) @ self.coefficients + _bilinear(self.correction, at)


def fit_ground(points_level: np.ndarray, config: GroundConfig = GROUND) -> GroundModel:
    """Fits the ground of one scan.

    Args:
        points_level: (n, >= 3) level frame, metres.
        config: see `GroundConfig`.

    Returns:
        The model; flat at the lowest percentile where there are too few points for a surface.
    """
    xyz = np.asarray(points_level, np.float32)[:, :3]
    if not len(xyz):
        return GroundModel(np.zeros(6), 1.0, np.zeros(2), config.cell_m, np.zeros((1, 1)))
    low = xyz[:, :2].min(axis=0)
    cell = np.floor((xyz[:, :2] - low) / np.float32(config.cell_m)).astype(np.int64)
    shape = cell.max(axis=0) + 1
    flat, height = _cell_heights(cell[:, 0] * shape[1] + cell[:, 1], xyz[:, 2], config)
    origin = low.astype(np.float64) + config.cell_m / 2
    ij = np.stack([flat // shape[1], flat % shape[1]], axis=1)
    centre = origin + ij * config.cell_m
    span = max(float(np.abs(centre).max(initial=0.0)), 1.0)
    if len(flat) < 6:
        level = np.percentile(xyz[:, 2], config.percentile)
        coefficients = np.array([level, 0, 0, 0, 0, 0], np.float64)
        return GroundModel(coefficients, span, origin, config.cell_m, np.zeros((1, 1)))
    basis = _basis(centre, span)
    coefficients, weight = _robust_fit(basis, height, config)
    residual = height - basis @ coefficients
    correction = _smoothed(ij, shape, residual, weight, config)
    return GroundModel(coefficients, span, origin, config.cell_m, correction)


def ground_mask(
    points_level: np.ndarray,
    model: GroundModel | None = None,
    threshold_m: float = GROUND.threshold_m,
) -> np.ndarray:
    """(n,) bool: points less than `threshold_m` above the ground, or below it.

    `points_level` is (n, >= 3); without a `model` one is fitted to the points.
    """
    model = fit_ground(points_level) if model is None else model
    points_level = np.asarray(points_level)
    return points_level[:, 2] - model.height(points_level[:, :2]) < threshold_m


def _basis(xy: np.ndarray, span: float) -> np.ndarray:
    x, y = xy[:, 0] / span, xy[:, 1] / span
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _cell_heights(
    key: np.ndarray, z: np.ndarray, config: GroundConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Cells with enough points: their keys (C,) ascending, and the low percentile of z (C,)."""
    order = np.argsort(z)
    order = order[np.argsort(key[order], kind="stable")]
    cells, first, count = np.unique(key[order], return_index=True, return_counts=True)
    at = first + ((count - 1) * config.percentile / 100).astype(np.int64)
    enough = count >= config.min_points
    return cells[enough], z[order[at[enough]]].astype(np.float64)


def _robust_fit(
    basis: np.ndarray, height: np.ndarray, config: GroundConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Reweighted least squares (Geman-McClure weights): coefficients (6,), weights (C,)."""
    coefficients = np.zeros(6)
    coefficients[0] = np.percentile(height, config.percentile)
    scales = np.geomspace(config.start_scale_m, config.scale_m, config.iterations)
    for scale in scales:
        residual = height - basis @ coefficients
        away = np.where(residual > 0, config.above_penalty, 1.0) * residual / scale
        weight = 1 / (1 + away**2) ** 2
        weighted = basis * weight[:, None]
        # The small ridge keeps directions without data (one row of cells) at zero.
        ridge = 1e-3 * np.diag([0.0, 1, 1, 1, 1, 1])
        coefficients = np.linalg.solve(weighted.T @ basis + ridge, weighted.T @ height)
    return coefficients, weight


def _smoothed(
    ij: np.ndarray,
    shape: np.ndarray,
    residual: np.ndarray,
    weight: np.ndarray,
    config: GroundConfig,
) -> np.ndarray:
    """(A, B) weighted Gaussian mean of the residuals around each cell, drawn towards 0."""
    mass, total = np.zeros(shape), np.zeros(shape)
    mass[ij[:, 0], ij[:, 1]] = weight
    total[ij[:, 0], ij[:, 1]] = weight * residual
    kernels = []
    for size in shape:
        step = np.subtract.outer(np.arange(size), np.arange(size)) * config.cell_m
        kernels.append(np.exp(-0.5 * (step / config.smooth_m) ** 2))
    along_x, along_y = kernels
    return (along_x @ total @ along_y) / (along_x @ mass @ along_y + config.prior_weight)


def _bilinear(grid: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values of `grid` (A, B) at fractional indices (n, 2), held constant beyond the edge."""
    limit = np.array(grid.shape) - 1
    at = np.clip(at, 0, limit)
    low = np.minimum(at.astype(np.int64), np.maximum(limit - 1, 0))
    high = np.minimum(low + 1, limit)
    u, v = (at - low).T
    return (
        grid[low[:, 0], low[:, 1]] * (1 - u) * (1 - v)
        + grid[high[:, 0], low[:, 1]] * u * (1 - v)
        + grid[low[:, 0], high[:, 1]] * (1 - u) * v
        + grid[high[:, 0], high[:, 1]] * u * v
    )
