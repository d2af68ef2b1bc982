"""Maps over the ground: a regular grid in world x, y."""

import numpy as np


class Grid:
    """A grid that covers `low` to `high` (2,), metres, with square cells of `cell` metres."""

    def __init__(self, low, high, cell: float, dtype=np.float32):
        self.low, self.cell = np.asarray(low, np.float64), float(cell)
        self.shape = tuple(int(np.ceil((h - w) / cell)) + 2 for w, h in zip(low, high, strict=True))
        self.values = np.zeros(self.shape, dtype)

    def index(self, xy) -> tuple[np.ndarray, np.ndarray]:
        """Cell indices of points (..., 2); points outside fall into the border cells."""
        cells = ((np.asarray(xy) - self.low) / self.cell).astype(np.int32)
        return (
            np.clip(cells[..., 0], 0, self.shape[0] - 1),
            np.clip(cells[..., 1], 0, self.shape[1] - 1),
        )

    def at(self, xy) -> np.ndarray:
        """Values of the cells that hold points (..., 2)."""
        return self.values[self.index(xy)]

    def bilinear(self, xy) -> np.ndarray:
        """Values between cell centres at points (..., 2); constant beyond the border."""
        place = (np.asarray(xy, np.float32) - self.low.astype(np.float32)) / np.float32(self.cell)
        place -= np.float32(0.5)
        limit = np.array(self.shape, np.float32) - np.float32(1.001)
        np.clip(place, 0, limit, out=place)
        cell = place.astype(np.int32)
        share = place - cell
        flat = cell[..., 0] * self.shape[1] + cell[..., 1]
        values = self.values.ravel()
        u, v = share[..., 0], share[..., 1]
        low = values[flat] * (1 - v) + values[flat + 1] * v
        high = values[flat + self.shape[1]] * (1 - v) + values[flat + self.shape[1] + 1] * v
        return low * (1 - u) + high * u

    def mark(self, xy, value=True) -> None:
        """Sets the cells that hold points (n, 2)."""
        self.values[self.index(xy)] = value


def blur(values, sigma_cells: float) -> np.ndarray:
    """Three box blurs in both directions, close to a Gaussian of `sigma_cells`; zero outside."""
    radius = max(round((np.sqrt(4 * sigma_cells**2 + 1) - 1) / 2), 1)
    result = np.asarray(values, np.float64)
    for axis in (0, 1):
        for _ in range(3):
            result = _box_blur(np.moveaxis(result, axis, 0), radius)
            result = np.moveaxis(result, 0, axis)
    return result


def _box_blur(values, radius: int) -> np.ndarray:
    width = 2 * radius + 1
    padded = np.concatenate(
        [np.zeros((radius + 1, values.shape[1])), values, np.zeros((radius, values.shape[1]))]
    )
    total = np.cumsum(padded, axis=0)
    return (total[width:] - total[:-width]) / width


def rectangle_points(center, yaw, length, width, spacing: float = 0.4) -> np.ndarray:
    """Points (n, 2) that cover a rectangle at most `spacing` metres apart."""
    along = np.linspace(-length / 2, length / 2, int(length / spacing) + 2)
    across = np.linspace(-width / 2, width / 2, int(width / spacing) + 2)
    u, v = (part.ravel() for part in np.meshgrid(along, across))
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([center[0] + cos * u - sin * v, center[1] + sin * u + cos * v], axis=1)
