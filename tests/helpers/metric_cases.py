"""Made-up sequences for the protocols: truth, results with every kind of mistake, and helpers."""

import numpy as np

from kitti.objects import Objects
from metrics.protocols import Entry

CAR_SIZE = (4.0, 1.8, 1.5)


def rows(kind, frame, track_id, boxes, bbox, *, score=np.nan, truncation=0, occlusion=0) -> Objects:
    """Objects from plain sequences; scalars hold for all rows."""
    n = len(frame)
    return Objects(
        frame=frame,
        track_id=np.broadcast_to(track_id, n),
        type=np.broadcast_to(kind, n),
        truncation=np.broadcast_to(truncation, n),
        occlusion=np.broadcast_to(occlusion, n),
        alpha=np.zeros(n),
        bbox=np.asarray(bbox, float).reshape(n, 4),
        boxes=np.asarray(boxes, float).reshape(n, 7),
        score=np.broadcast_to(score, n),
    )


def one_object(history: str) -> Entry:
    """One car that stands still; digits are the result's id in each frame, 0 none."""
    frames = np.arange(len(history))
    box, bbox = (20.0, 0.0, 0.0, *CAR_SIZE, 0.0), (100.0, 100.0, 200.0, 180.0)
    truth = rows("Car", frames, 7, [box] * len(frames), [bbox] * len(frames))
    seen = np.array([t for t in frames if history[t] != "0"], int)
    ids = [int(history[t]) for t in seen]
    results = rows("Car", seen, ids, [box] * len(seen), [bbox] * len(seen), score=1.0)
    return Entry("0000", len(frames), truth, results)


def random_entry(seed: int, frames: int = 25, objects: int = 4, name: str = "0000") -> Entry:
    """A few moving cars and vans, DontCare regions, and a careless tracker's output."""
    rng = np.random.default_rng(seed)
    truth, results = [], []
    for k in range(objects):
        truth.append(_object(rng, k, frames))
        results.append(_tracked(rng, truth[-1], 10 * k))
    results.append(_false_alarms(rng, frames))
    truth += [_dontcare(rng, frames), _pedestrian(rng, frames)]
    return Entry(name, frames, _unique(truth), _unique(results))


def _object(rng, k: int, frames: int) -> Objects:
    first, last = sorted(rng.choice(frames + 1, 2, replace=False))
    present = np.array([t for t in range(first, last) if rng.random() > 0.1], int)
    n = len(present)
    place = np.array([15 + 4 * rng.random(), 3.0 * k, 0.0]) + present[:, None] * rng.normal(
        0, 0.3, 3
    )
    boxes = np.column_stack([place, np.tile(CAR_SIZE, (n, 1)), np.full(n, rng.uniform(-3, 3))])
    kind = np.where(rng.random() < 0.3, "Van", "Car")
    return rows(
        kind,
        present,
        k,
        boxes,
        _image(boxes),
        truncation=rng.choice([0, 0, 0, 1], n),
        occlusion=rng.choice([0, 1, 2, 3], n, p=[0.5, 0.2, 0.1, 0.2]),
    )


def _image(boxes: np.ndarray) -> np.ndarray:
    """A 2-D box that moves with the 3-D box; heights on both sides of 25 pixels."""
    u, v = 500 - 40 * boxes[:, 1], 150 + 10 * boxes[:, 0]
    height = 12 + 2.0 * boxes[:, 0] * boxes[:, 5] / 1.5
    return np.column_stack([u, v, u + 70, v + height])


def _tracked(rng, truth: Objects, first_id: int) -> Objects:
    seen = truth[rng.random(len(truth)) > 0.25]
    boxes = seen.boxes + rng.normal(0, 1, (len(seen), 7)) * [0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1]
    ids = first_id + np.cumsum(rng.random(len(seen)) < 0.15)
    kind = np.where(rng.random(len(seen)) < 0.1, "Van", "Car")
    score = rng.normal(3, 2, 100)[ids % 100] + rng.normal(0, 0.3, len(seen))
    return rows(kind, seen.frame, ids, boxes, _image(boxes), score=score)


def _false_alarms(rng, frames: int) -> Objects:
    frame = np.flatnonzero(rng.random(frames) < 0.6)
    n = len(frame)
    place = rng.uniform([5, -12, 0], [30, 12, 1], (n, 3))
    boxes = np.column_stack([place, np.tile(CAR_SIZE, (n, 1)), rng.uniform(-3, 3, n)])
    ids = 900 + np.arange(n) // 3
    return rows("Car", frame, ids, boxes, _image(boxes), score=rng.normal(1, 1, n))


def _dontcare(rng, frames: int) -> Objects:
    frame = np.flatnonzero(rng.random(frames) < 0.8)
    corner = rng.uniform([100, 150], [700, 300], (len(frame), 2))
    bbox = np.column_stack([corner, corner + rng.uniform(50, 300, (len(frame), 2))])
    return rows("DontCare", frame, -1, np.full((len(frame), 7), np.nan), bbox, truncation=-1)


def _pedestrian(rng, frames: int) -> Objects:
    frame = np.arange(frames)
    boxes = np.tile([8.0, -2.0, 0.0, 0.8, 0.6, 1.7, 0.0], (frames, 1))
    return rows("Pedestrian", frame, 500, boxes, _image(boxes))


def _unique(parts: list[Objects]) -> Objects:
    """Rows in file order, each (frame, id) once (DontCare rows all have id -1)."""
    together = Objects.concatenate(parts)
    order = np.argsort(together.frame, kind="stable")
    together = together[order]
    key = together.frame.astype(np.int64) * 10_000 + together.track_id
    _, first = np.unique(key, return_index=True)
    keep = np.isin(np.arange(len(key)), first) | (together.track_id < 0)
    return together[keep]
