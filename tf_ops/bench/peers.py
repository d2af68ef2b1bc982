"""The peers with two threads each, over a batch of clouds in sequence."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import fpsample
import numpy as np
import pynanoflann
import shapely
from pykdtree.kdtree import KDTree
from scipy.spatial import cKDTree

THREADS = 2
HEIGHTS = (3, 5, 7, 9)  # of fpsample's k-d tree
POOL = ThreadPoolExecutor(THREADS)

Clouds = np.ndarray  # (B, N, 3) float32


def fps(height: int) -> Callable[[Clouds, int], list]:
    """fpsample's fastest sampler over clouds in sequence, with one thread."""
    return lambda clouds, npoint: [_sample(xyz, npoint, height) for xyz in clouds]


def fps_pooled(height: int) -> Callable[[Clouds, int], list]:
    """As `fps`, with the clouds divided among two threads."""
    return lambda clouds, npoint: list(POOL.map(lambda xyz: _sample(xyz, npoint, height), clouds))


def _sample(xyz: np.ndarray, npoint: int, height: int) -> np.ndarray:
    return fpsample.bucket_fps_kdline_sampling(xyz, npoint, height, start_idx=0)


def ball_scipy(radius: float, clouds: Clouds, queries: Clouds) -> list:
    return [
        cKDTree(xyz).query_ball_point(q, radius, workers=THREADS)
        for xyz, q in zip(clouds, queries, strict=True)
    ]


def knn_scipy(k: int, clouds: Clouds, queries: Clouds) -> list:
    return [
        cKDTree(xyz).query(q, k=k, workers=THREADS) for xyz, q in zip(clouds, queries, strict=True)
    ]


def knn_pykdtree(k: int, clouds: Clouds, queries: Clouds) -> list:
    """Threads: OMP_NUM_THREADS."""
    return [KDTree(xyz).query(q, k=k) for xyz, q in zip(clouds, queries, strict=True)]


def knn_pynanoflann(k: int, clouds: Clouds, queries: Clouds) -> list:
    found = []
    for xyz, q in zip(clouds, queries, strict=True):
        tree = pynanoflann.KDTree(n_neighbors=k, metric="L2", leaf_size=10)
        tree.fit(xyz)
        found.append(tree.kneighbors(q, n_jobs=THREADS))
    return found


KNN = {"scipy": knn_scipy, "pykdtree": knn_pykdtree, "pynanoflann": knn_pynanoflann}


def corners(boxes: np.ndarray) -> np.ndarray:
    """(M, 7) -> (M, 4, 2), seen from above."""
    half = 0.5 * boxes[:, None, 3:5] * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    cosine, sine = np.cos(boxes[:, 6:]), np.sin(boxes[:, 6:])
    x = boxes[:, :1] + cosine * half[..., 0] - sine * half[..., 1]
    y = boxes[:, 1:2] + sine * half[..., 0] + cosine * half[..., 1]
    return np.stack([x, y], -1)


def iou_shapely(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """3-D IoU of all pairs, vectorised, with the rows divided among the threads."""
    p, q = shapely.polygons(corners(a)), shapely.polygons(corners(b))

    def shared_area(rows):
        return shapely.area(shapely.intersection(rows[:, None], q[None]))

    area = np.concatenate(list(POOL.map(shared_area, np.array_split(p, THREADS))))
    top = np.minimum.outer(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = np.maximum.outer(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    shared = area * np.maximum(top - bottom, 0)
    return shared / (np.add.outer(a[:, 3:6].prod(1), b[:, 3:6].prod(1)) - shared)


def suppress_shapely(
    boxes: np.ndarray, weight: np.ndarray, vote_iou: float, nms_iou: float
) -> list[int]:
    """Rows of the boxes that are kept by suppression, most supported first."""
    iou, kept = iou_shapely(boxes, boxes), []
    free = np.argsort(-(np.where(iou >= vote_iou, iou, 0) @ weight))
    while len(free):
        kept.append(int(free[0]))
        free = free[iou[free[0], free] <= nms_iou]
    return kept
