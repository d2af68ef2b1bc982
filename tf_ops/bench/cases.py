"""The cases of the benchmark: ops, peers and goals."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tensorflow as tf

import tf_ops
from tf_ops.bench import peers, scans

Call = Callable[[], object]


@dataclass(frozen=True)
class Case:
    """One row: calls that do the same work, and the goal, the largest ratio of their times."""

    name: str
    batch: int
    ours: Call
    peers: dict[str, Call]
    goal: float


def fps_peers(clouds: np.ndarray, npoint: int) -> dict[str, Call]:
    found = {}
    for h in peers.HEIGHTS:
        found[f"fpsample h={h}"] = partial(peers.fps(h), clouds, npoint)
        if len(clouds) > 1:
            found[f"fpsample h={h}, 2 threads"] = partial(peers.fps_pooled(h), clouds, npoint)
    return found


def knn_peers(k: int, clouds: np.ndarray, queries: np.ndarray) -> dict[str, Call]:
    return {name: partial(knn, k, clouds, queries) for name, knn in peers.KNN.items()}


def cloud_cases(kitti_root: Path, batch: int) -> Iterator[Case]:
    """Ops on coordinates. A batch holds copies of one cloud, rotated about the vertical."""
    xyz = turned(scans.scan(kitti_root, 15000)[0], batch)
    points = tf.constant(xyz)
    sampled = tf_ops.gather_point(points, tf_ops.farthest_point_sample(2048, points))
    sparse = sampled[:, :512]  # the farthest 512 are the first 512 of the farthest 2048
    s, p = sampled.numpy(), sparse.numpy()
    yield Case(
        "FPS 15000 -> 2048",
        batch,
        lambda: tf_ops.farthest_point_sample(2048, points),
        fps_peers(xyz, 2048),
        0.5,
    )
    if batch == 1:
        yield large_case(1)
    yield Case(
        "ball query, r = 1, 32 of 15000 for 2048",
        batch,
        lambda: tf_ops.query_ball_point(1.0, 32, points, sampled),
        {"scipy": partial(peers.ball_scipy, 1.0, xyz, s)},
        0.25,
    )
    yield Case(
        "kNN, k = 64, 512 in 512",
        batch,
        lambda: tf_ops.knn_point(64, sparse, sparse),
        knn_peers(64, p, p),
        0.5,
    )
    yield Case(
        "kNN, k = 8 of 2048 for 15000",
        batch,
        lambda: tf_ops.knn_point(8, sampled, points),
        knn_peers(8, s, xyz),
        0.5,
    )
    yield Case(
        "three_nn, 15000 in 2048",
        batch,
        lambda: tf_ops.three_nn(points, sampled),
        knn_peers(3, s, xyz),
        0.5,
    )


def large_case(batch: int) -> Case:
    large = turned(scans.synthesised_scan(100000), batch)
    points = tf.constant(large)
    return Case(
        "FPS 100000 -> 16384",
        batch,
        lambda: tf_ops.farthest_point_sample(16384, points),
        fps_peers(large, 16384),
        0.7,
    )


def turned(xyz: np.ndarray, batch: int) -> np.ndarray:
    """(N, 3) -> (batch, N, 3) float32, cloud b turned by b radians."""
    angles = np.arange(batch)
    zero, one = np.zeros(batch), np.ones(batch)
    rows = [
        [np.cos(angles), np.sin(angles), zero],
        [-np.sin(angles), np.cos(angles), zero],
        [zero, zero, one],
    ]
    return np.einsum("nc,cdb->bnd", xyz, np.array(rows)).astype(np.float32)


def box_case() -> Case:
    a, b = scans.boxes(200, 0), scans.boxes(200, 1)
    first, second = tf.constant(a), tf.constant(b)
    return Case(
        "box_iou_3d 200 x 200",
        1,
        lambda: tf_ops.box_iou_3d(first, second),
        {"shapely": partial(peers.iou_shapely, a, b)},
        0.05,
    )


def suppression_case() -> Case:
    boxes, limits = scans.boxes(600, 0), {"vote_iou": 0.4, "nms_iou": 0.02}
    weight = np.random.default_rng(0).uniform(0.4, 1, len(boxes)).astype(np.float32)
    first, second = tf.constant(boxes), tf.constant(weight)
    return Case(
        "suppress_boxes, 600",
        1,
        lambda: tf_ops.suppress_boxes(first, second, max_boxes=600, **limits),
        {"shapely": partial(peers.suppress_shapely, boxes, weight, **limits)},
        0.05,
    )


def feature_cases(kitti_root: Path) -> Iterator[Case]:
    """group_point and its gradient, with the indices of a ball query."""
    xyz = tf.constant(turned(scans.scan(kitti_root, 15000)[0], 8))
    sampled = tf_ops.gather_point(xyz, tf_ops.farthest_point_sample(2048, xyz))
    index, _ = tf_ops.query_ball_point(1.0, 32, xyz, sampled)
    points, upstream = tf.random.normal((8, 15000, 64)), tf.random.normal((8, 2048, 32, 64))
    gathers = {"ours": tf_ops.group_point, "tf.gather": partial(tf.gather, batch_dims=1)}

    def gradient(gather):
        @tf.function(autograph=False)
        def run(p, grad):
            with tf.GradientTape() as tape:
                tape.watch(p)
                grouped = gather(p, index)
            return tf.convert_to_tensor(tape.gradient(grouped, p, grad))

        return lambda: run(points, upstream)

    forward = {name: partial(gather, points, index) for name, gather in gathers.items()}
    backward = {name: gradient(gather) for name, gather in gathers.items()}
    for name, calls, goal in (("", forward, 1.0), (", gradient", backward, 0.5)):
        yield Case(
            f"group_point (8, 2048, 32, 64){name}",
            8,
            calls["ours"],
            {"tf.gather": calls["tf.gather"]},
            goal,
        )


def all_cases(kitti_root: Path) -> list[Case]:
    """The cases of one cloud, of a batch of eight, and of boxes and features."""
    return [
        *cloud_cases(kitti_root, 1),
        *cloud_cases(kitti_root, 8),
        large_case(8),
        box_case(),
        suppression_case(),
        *feature_cases(kitti_root),
    ]
