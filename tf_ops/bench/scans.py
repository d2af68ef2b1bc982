"""Clouds of the benchmark: a real scan if available, and synthesised ones."""

from pathlib import Path

import numpy as np

REAL = Path("training/velodyne/0000/000120.bin")
SENSOR_HEIGHT_M = 1.73  # KITTI's Velodyne above the ground (Geiger et al., IJRR 2013)
ELEVATION_DEG = (-24.8, 2.0)  # the HDL-64E's vertical field of view


def synthesised_scan(size: int, seed: int = 0) -> np.ndarray:
    """(size, 3) float32 points of a spinning sensor between walls on flat ground, metres."""
    rng = np.random.default_rng(seed)
    elevation = np.radians(rng.choice(np.linspace(*ELEVATION_DEG, 64), size))
    azimuth = rng.uniform(-np.pi, np.pi, size)
    walls = rng.uniform(6, 70, 90)[((azimuth + np.pi) / (2 * np.pi) * 90).astype(int) % 90]
    with np.errstate(divide="ignore"):
        ground = np.where(elevation < 0, SENSOR_HEIGHT_M / -np.tan(elevation), np.inf)
    reach = np.minimum(ground, walls) + rng.normal(0, 0.02, size)
    xyz = [reach * np.cos(azimuth), reach * np.sin(azimuth), reach * np.tan(elevation)]
    return np.stack(xyz, -1).astype(np.float32)


def scan(kitti_root: Path, size: int) -> tuple[np.ndarray, str]:
    """(size, 3) float32 points and a description of their source."""
    path = kitti_root / REAL
    if not path.is_file():
        return synthesised_scan(size), f"{size} points of a synthesised scan"
    points = np.fromfile(path, np.float32).reshape(-1, 4)[:, :3]
    chosen = np.random.default_rng(0).permutation(len(points))[:size]
    return np.ascontiguousarray(points[chosen]), f"{size} random points of KITTI scan 0000/000120"


def boxes(count: int, seed: int) -> np.ndarray:
    """(count, 7) float32 boxes of cars, crowded enough that many overlap."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform([0, -20, -2], [40, 20, -1], (count, 3))
    size = rng.normal([4, 1.7, 1.6], 0.2, (count, 3))
    yaw = rng.uniform(-np.pi, np.pi, (count, 1))
    return np.concatenate([centre, size, yaw], 1).astype(np.float32)
