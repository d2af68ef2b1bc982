"""Velodyne scans: reading and writing `.bin` files, the camera's crop, drawing N points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import write_bytes
from kitti.boxes import IMAGE_SIZE
from kitti.calibration import Calibration
from kitti.tables import read_bytes

BYTES_PER_POINT = 16
"""A point is four little-endian float32: x, y, z in metres (Velodyne frame) and intensity."""
MIN_DEPTH = 0.1
"""Metres in front of the left colour camera from which on a point counts as seen."""


def read_scan(path: str | Path) -> np.ndarray:
    """Reads a scan: (n, 4) float32 x, y, z (metres, Velodyne frame), intensity in [0, 1].

    Raises:
        InputError: the file cannot be read, is empty, is no whole number of points, or holds a
            value that is not finite.
    """
    data = read_bytes(path)
    if not data or len(data) % BYTES_PER_POINT:
        raise InputError(
            f"expected a positive multiple of {BYTES_PER_POINT} bytes, found {len(data)}", path
        )
    points = np.frombuffer(data, "<f4").astype(np.float32, copy=True).reshape(-1, 4)
    if not np.isfinite(points).all():
        row = int(np.argmax(~np.isfinite(points).all(axis=1)))
        raise InputError(f"point {row}: expected finite numbers", path)
    return points


def write_scan(path: str | Path, points: np.ndarray) -> None:
    """Writes (n, 4) points (Velodyne frame) as float32, atomically."""
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 4:
        raise ValueError(f"expected points of shape (n, 4), found {points.shape}")
    write_bytes(path, np.ascontiguousarray(points, "<f4").tobytes())


def in_camera_view(
    points_level: np.ndarray,
    calib: Calibration,
    image_size: tuple[int, int] = IMAGE_SIZE,
    min_depth: float = MIN_DEPTH,
) -> np.ndarray:
    """(n,) bool: the points (n, >= 3, level frame) that fall into the left colour image."""
    uv, depth = calib.project_level(points_level[:, :3])
    width, height = image_size
    seen = depth > min_depth
    seen &= (uv[:, 0] >= 0) & (uv[:, 0] < width)
    seen &= (uv[:, 1] >= 0) & (uv[:, 1] < height)
    return seen


def sample_points(points: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (n,) int64 of `n` of the points, in random order.

    Without replacement where there are enough; otherwise every point once and the rest repeated
    at random.

    Raises:
        ValueError: there is no point to draw from.
    """
    count = len(points)
    if count == 0 and n > 0:
        raise ValueError(f"cannot draw {n} points from none")
    if count >= n:
        return rng.permutation(count)[:n]
    return rng.permutation(np.concatenate([np.arange(count), rng.integers(0, count, n - count)]))
