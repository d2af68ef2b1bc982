"""Ground points by a fitted surface: a robust quadratic plus a smooth local correction.

1. The scan is cut into square cells; each gives a low percentile of its heights, rounded down to
   one of its points: the lowest of 3 to 10, the second lowest of 11 to 20.
2. A quadratic in x, y (slope, crown, the bend of a hill) is fitted by reweighted least squares;
   cells above the surface (cars, walls, trees) lose their weight sooner than cells below.
3. 1 and 2 are repeated on heights relative to that surface, without the slope inside a cell.
4. The residuals of the cells near the surface are smoothed over their neighbourhood and added.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GroundConfig:
    """Parameters of the fit, our choices: the paper only states that ground is extracted."""

    cell_m: float = 2.0  # smaller than a car's footprint is long, larger than the ring spacing
    percentile: float = 10.0  # low, and from 11 points on not the lowest: reflections lie below
    min_points: int = 3  # fewer points do not determine the lower envelope of a cell
    iterations: int = 8
    max_range_m: float = 200.0  # farther points are ignored; the sensor reaches 120 m
    scale_m: float = 0.15  # cells within this of the surface count fully
    start_scale_m: float = 1.2  # the scale of the first iteration; it shrinks to scale_m
    above_penalty: float = 3.0  # factor on residuals of cells above the surface
    smooth_m: float = 4.0  # standard deviation of the local correction's neighbourhood
    prior_weight: float = 2.0  # zero corrections, in cells; damps cells without neighbours
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
        x, y = np.array(np.asarray(xy)[:, :2].T, np.float64)
        i, j = (x - self.origin[0]) / self.cell_m, (y - self.origin[1]) / self.cell_m
        return _polynomial(x, y, self.coefficients, self.span) + _bilinear(self.correction, i, j)


def fit_ground(points_level: np.ndarray) -> GroundModel:
    """Fits the ground of one scan (n, >= 3), level frame, metres.

    With too few points for a surface it is flat, at the lowest percentile.
    """
    xyz = np.asarray(points_level, np.float32)[:, :3]
    xyz = xyz[(np.abs(xyz[:, :2]) <= GROUND.max_range_m).all(axis=1)]
    if not len(xyz):
        return GroundModel(np.zeros(6), 1.0, np.zeros(2), GROUND.cell_m, np.zeros((1, 1)))
    cells = _Cells.of(xyz[:, :2], GROUND.cell_m)
    span = max(float(np.abs(xyz[:, :2]).max()), 1.0)
    surface = np.array([np.percentile(xyz[:, 2], GROUND.percentile), 0, 0, 0, 0, 0])
    residual = weight = np.zeros(0)
    ij = np.zeros((0, 2), np.int64)
    for start_scale in (GROUND.start_scale_m, GROUND.scale_m):
        above = xyz[:, 2] - _polynomial(xyz[:, 0], xyz[:, 1], surface, span)
        ij, height = cells.low_heights(above)
        if len(height) < 6:
            break
        basis = _basis(cells.origin + ij * GROUND.cell_m, span)
        change, weight = _robust_fit(basis, height, start_scale)
        surface, residual = surface + change, height - basis @ change
    correction = _smoothed(ij[: len(weight)], cells.shape, residual, weight)
    return GroundModel(surface, span, cells.origin, GROUND.cell_m, correction)


def ground_mask(points_level: np.ndarray, model: GroundModel | None = None) -> np.ndarray:
    """(n,) bool: points less than `GROUND.threshold_m` above the ground, or below it.

    `points_level` is (n, >= 3); without a `model` one is fitted to the points.
    """
    model = fit_ground(points_level) if model is None else model
    points_level = np.asarray(points_level)
    return points_level[:, 2] - model.height(points_level[:, :2]) < GROUND.threshold_m


@dataclass(frozen=True, eq=False)
class _Cells:
    """Square cells over n points: flat cell number of each (n,), grid shape, centre of cell 0."""

    number: np.ndarray
    shape: tuple[int, int]
    origin: np.ndarray

    @staticmethod
    def of(xy: np.ndarray, cell_m: float) -> "_Cells":
        low = xy.min(axis=0)
        ij = ((xy - low) / np.float32(cell_m)).astype(np.int64)
        rows, columns = (int(size) for size in ij.max(axis=0) + 1)
        origin = low.astype(np.float64) + cell_m / 2
        return _Cells(ij[:, 0] * columns + ij[:, 1], (rows, columns), origin)

    def low_heights(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cells with enough points: their indices (C, 2) and the low percentile of z (C,)."""
        # One sort of integers does both: the cell in the high bits, tenths of a millimetre below.
        base = float(z.min())
        fine = np.minimum((z - base) * 1e4, 2**31).astype(np.int64)
        ordered = np.sort(self.number << 32 | fine)
        number = ordered >> 32
        first = np.flatnonzero(np.diff(number, prepend=-1))
        count = np.diff(first, append=len(number))
        at = first + ((count - 1) * GROUND.percentile / 100).astype(np.int64)
        at = at[count >= GROUND.min_points]
        ij = np.stack(np.divmod(number[at], self.shape[1]), axis=1)
        return ij, (ordered[at] & 0xFFFFFFFF) / 1e4 + base


def _basis(xy: np.ndarray, span: float) -> np.ndarray:
    x, y = xy[:, 0] / span, xy[:, 1] / span
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _polynomial(x: np.ndarray, y: np.ndarray, c: np.ndarray, span: float) -> np.ndarray:
    """The surface `_basis` @ c at (n,) x, y, without the (n, 6) array."""
    c = c / np.array([1, span, span, span**2, span**2, span**2])
    return c[0] + x * (c[1] + c[3] * x + c[4] * y) + y * (c[2] + c[5] * y)


def _robust_fit(
    basis: np.ndarray, height: np.ndarray, start_scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Reweighted least squares (Geman-McClure weights): coefficients (6,), weights (C,)."""
    coefficients = np.zeros(6)
    coefficients[0] = np.percentile(height, GROUND.percentile)
    scales = np.geomspace(start_scale, GROUND.scale_m, GROUND.iterations)
    for scale in scales:
        residual = height - basis @ coefficients
        away = np.where(residual > 0, GROUND.above_penalty, 1.0) * residual / scale
        weight = 1 / (1 + away**2) ** 2
        weighted = basis * weight[:, None]
        # The small ridge keeps directions without data (one row of cells) at zero.
        ridge = 1e-3 * np.diag([0.0, 1, 1, 1, 1, 1])
        coefficients = np.linalg.solve(weighted.T @ basis + ridge, weighted.T @ height)
    return coefficients, weight


def _smoothed(
    ij: np.ndarray, shape: tuple[int, int], residual: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """(A, B) weighted Gaussian mean of the residuals around each cell, drawn towards 0."""
    mass, total = np.zeros(shape), np.zeros(shape)
    mass[ij[:, 0], ij[:, 1]] = weight
    total[ij[:, 0], ij[:, 1]] = weight * residual
    kernels = []
    for size in shape:
        step = np.subtract.outer(np.arange(size), np.arange(size)) * GROUND.cell_m
        kernels.append(np.exp(-0.5 * (step / GROUND.smooth_m) ** 2))
    along_x, along_y = kernels
    return (along_x @ total @ along_y) / (along_x @ mass @ along_y + GROUND.prior_weight)


def _bilinear(grid: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Values of `grid` (A, B) at fractional indices (n,), held constant beyond the edge."""
    padded = np.pad(grid, ((0, 1), (0, 1)), mode="edge")
    i, j = (np.clip(at, 0, size - 1) for at, size in zip((i, j), grid.shape, strict=True))
    row, column = i.astype(np.int64), j.astype(np.int64)
    u, v = i - row, j - column
    flat, at, width = padded.ravel(), row * padded.shape[1] + column, padded.shape[1]
    left = flat[at] + u * (flat[at + width] - flat[at])
    right = flat[at + 1] + u * (flat[at + width + 1] - flat[at + 1])
    return left + v * (right - left)
