"""Slow NumPy references of the ops, and the clouds they are compared on."""

import numpy as np

KINDS = ("random", "clustered", "collinear", "identical", "lattice")


def cloud(kind: str, batch: int, size: int, seed: int = 0) -> np.ndarray:
    """(batch, size, 3) float32 points."""
    rng = np.random.default_rng([seed, size, KINDS.index(kind)])
    shape = (batch, size, 3)
    if kind == "clustered":
        centres = rng.normal(0, 20, (3, 3))
        points = centres[rng.integers(0, 3, (batch, size))] + rng.normal(0, 0.05, shape)
    elif kind == "collinear":
        points = rng.normal(0, 3, (batch, size, 1)) * np.array([1.0, -2.0, 0.5])
    elif kind == "identical":
        points = np.full(shape, 1.25)
    elif kind == "lattice":
        points = rng.integers(-2, 3, shape)
    else:
        points = rng.normal(0, 2, shape)
    return points.astype(np.float32)


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(B, N, 3), (B, M, 3) -> (B, N, M) float32, in the ops' order of operations."""
    d = a[:, :, None] - b[:, None]
    d = d * d
    return (d[..., 0] + d[..., 1]) + d[..., 2]


def farthest_point_sample(npoint: int, xyz: np.ndarray) -> np.ndarray:
    """The next sample is the first point of largest distance to the samples before it."""
    index = np.zeros((len(xyz), npoint), np.int32)
    for b, points in enumerate(xyz):
        nearest = np.full(len(points), np.inf, np.float32)
        for i in range(1, npoint):
            last = points[None, index[b, i - 1]][None]
            nearest = np.minimum(nearest, squared_distances(last, points[None])[0, 0])
            index[b, i] = np.argmax(nearest)
    return index


def smallest(k: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices and values of the k smallest of each row, the rest repeating the smallest."""
    index = np.argsort(rows, axis=-1, kind="stable")[..., :k]
    missing = k - index.shape[-1]
    index = np.concatenate([index] + [index[..., :1]] * missing, -1)
    return index, np.take_along_axis(rows, index, -1)


def query_ball_point(
    radius: float, nsample: int, xyz1: np.ndarray, xyz2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The first nsample points inside, padded with the first; the nearest if there is none."""
    dist2 = squared_distances(xyz2, xyz1)
    limit = np.float32(radius) * np.float32(radius)
    index = np.zeros((*dist2.shape[:2], nsample), np.int32)
    count = np.zeros(dist2.shape[:2], np.int32)
    for place in np.ndindex(*dist2.shape[:2]):
        inside = np.flatnonzero(dist2[place] < limit)[:nsample]
        count[place] = len(inside)
        index[place] = inside[0] if len(inside) else np.argmin(dist2[place])
        index[place][: len(inside)] = inside
    return index, count


def group(points: np.ndarray, index: np.ndarray) -> np.ndarray:
    """points[b, index[b, ...]]."""
    return np.stack([p[i] for p, i in zip(points, index, strict=True)])
