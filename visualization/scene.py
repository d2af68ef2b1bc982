"""A drive as data of the 3-D scene: points, boxes with ids and speeds, errors per frame.

Letters: F frames, R rows of boxes, n points of a frame.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from kitti.iou import iou_3d
from kitti.labels import VEHICLES, Objects
from metrics.clear3d import row_errors
from metrics.comparison import compare
from visualization.clip import Clip
from visualization.drawing import id_color

PERIOD = 0.1  # seconds between two frames: KITTI's scanner turns ten times a second
STEP = 0.01  # metres; points are rounded to it, so that a coordinate takes two bytes
POINTS_PER_FRAME = 8000
POINTS_IN_ALL = 1_500_000  # 9.3 bytes each in the file
MATCHED, FALSE_ALARM, SWITCH, NOT_EVALUATED = 0, 1, 2, -1
DIM = (84, 94, 114)  # RGB of shading 0
BRIGHT = {"intensity": (236, 241, 250), "foreground probability": (255, 150, 40)}
"""RGB of shading 1, by what the points' fourth column holds."""
ID_LIGHTNESS = (0.66, 0.56, 0.74, 0.61)  # bright, for the dark background


def pack(values: Any, dtype: str) -> dict[str, str]:
    """An array as the page decodes it: {"type", "data" in base64, little-endian}."""
    data = np.ascontiguousarray(values, np.dtype(dtype).newbyteorder("<")).tobytes()
    return {"type": dtype, "data": base64.b64encode(data).decode("ascii")}


def tracks_of(objects: Objects) -> np.ndarray:
    """(R,) index of each row's track: one per id; per id and class where a frame repeats an id."""
    frames_and_ids = np.stack([objects.frame, objects.track_id])
    unique = np.unique(frames_and_ids, axis=1).shape[1] == len(objects)
    classes = np.zeros(len(objects), int) if unique else np.unique(objects.type, False, True)[1]
    keys = np.stack([objects.track_id, classes])
    return np.unique(keys, axis=1, return_inverse=True)[1].reshape(-1)


def speeds(objects: Objects, poses: np.ndarray | None) -> np.ndarray:
    """(R,) m/s of each row's track in the plane, by central differences; NaN for a lone row.

    Over ground where `poses` (F, 4, 4) are known, else relative to the sensor.
    """
    centres = objects.boxes[:, :3].copy()
    if poses is not None:
        matrix = poses[objects.frame]
        centres = np.einsum("rij,rj->ri", matrix[:, :3, :3], centres) + matrix[:, :3, 3]
    result, track = np.full(len(objects), np.nan), tracks_of(objects)
    for index in np.unique(track):
        rows = np.flatnonzero(track == index)
        rows = rows[np.argsort(objects.frame[rows], kind="stable")]
        if len(rows) > 1:
            velocity = np.gradient(centres[rows, :2], objects.frame[rows] * PERIOD, axis=0)
            result[rows] = np.linalg.norm(velocity, axis=1)
    return result


def thin(points: np.ndarray, limit: int, frame: int) -> np.ndarray:
    """At most `limit` of the points (n, C), drawn at random with the frame as seed."""
    if len(points) <= limit:
        return points
    rows = np.random.default_rng(frame).choice(len(points), limit, replace=False)
    return points[np.sort(rows)]


def pack_points(points: np.ndarray) -> str:
    """(n, 3 or 4) points -> base64: xyz as int16 in steps of `STEP`, then shading as uint8.

    The fourth column is the shading, 0 to 1. What lies beyond the range of int16 (327 m) is left
    out.
    """
    steps = np.round(points[:, :3] / STEP)
    inside = (np.abs(steps) <= np.iinfo(np.int16).max).all(axis=1)
    shade = points[:, 3] if points.shape[1] > 3 else np.full(len(points), 0.5)
    shade = np.round(255 * np.clip(shade, 0, 1)).astype(np.uint8)
    data = steps[inside].astype("<i2").tobytes() + shade[inside].tobytes()
    return base64.b64encode(data).decode("ascii")


def errors_of(
    truth: Objects, results: Objects, num_frames: int, min_iou: float
) -> tuple[np.ndarray, np.ndarray]:
    """The errors that evaluate.py's `clear3d` counts: (R,) bool misses, (S,) int8 of results.

    A result is MATCHED, a FALSE_ALARM, a SWITCH, or NOT_EVALUATED (another class, or no labels).
    """
    status = np.full(len(results), NOT_EVALUATED, np.int8)
    if not len(truth):
        return np.zeros(0, bool), status
    evaluated = np.isin(results.type, VEHICLES)
    comparison = compare("", num_frames, truth, results[evaluated], iou_3d)
    errors = row_errors(comparison, np.ones(evaluated.sum(), bool), min_iou)
    status[evaluated] = np.where(
        errors.switched, SWITCH, np.where(errors.false_alarm, FALSE_ALARM, MATCHED)
    )
    return errors.missed, status


def pack_boxes(
    name: str, objects: Objects, poses: np.ndarray | None, errors: list[np.ndarray], color=None
) -> dict[str, Any]:
    """Rows of boxes, their speeds and colours; `errors` are (R,) arrays of small integers."""
    types, kind = np.unique(objects.type, return_inverse=True)
    track = tracks_of(objects)
    ids = objects.track_id[np.unique(track, return_index=True)[1]].tolist()
    return {
        "name": name,
        "frame": pack(objects.frame, "int32"),
        "track": pack(track, "int32"),
        "ids": [str(i) for i in ids],
        "types": types.tolist(),
        "type": pack(kind, "uint8"),
        "score": pack(objects.score, "float32"),
        "speed": pack(speeds(objects, poses), "float32"),
        "box": pack(objects.boxes, "float32"),
        "errors": [pack(values, "int8") for values in errors],
        "colors": [_rgb(id_color(i, ID_LIGHTNESS)) if color is None else color for i in ids],
    }


def scene_data(
    clip: Clip,
    trackers: Mapping[str, Objects],
    *,
    min_iou: float = 0.5,
    shading: str = "intensity",
    first: int = 0,
    points_per_frame: int = POINTS_PER_FRAME,
) -> dict[str, Any]:
    """The scene, JSON-ready.

    Args:
        clip: scans, labels and poses; its own results are not used.
        trackers: name -> rows of a result file, in the order of the panel.
        min_iou: least 3-D IoU of a match, as in evaluate.py.
        shading: what the points' fourth column is, a key of `BRIGHT`.
        first: number that the page shows for frame 0.
        points_per_frame: at most so many points of a frame are kept; long drives keep fewer.
    """
    trackers = {name: rows[np.isfinite(rows.boxes).all(axis=1)] for name, rows in trackers.items()}
    found = [errors_of(clip.truth, rows, clip.num_frames, min_iou) for rows in trackers.values()]
    limit = min(points_per_frame, max(1, POINTS_IN_ALL // clip.num_frames))
    points, notes = _points(clip, limit, shading)
    speed = "speed" if clip.poses is not None else "speed relative to the sensor"
    notes += [
        f"Labels, where there are any, and tracks in the sensor's level frame; {speed} from "
        f"central differences, {1 / PERIOD:g} frames a second.",
        f"Errors: clear3d of evaluate.py, classes {', '.join(VEHICLES)}, 3-D IoU at least "
        f"{min_iou:g}." if len(clip.truth) else "No labels: errors are unknown.",
        "World view and ground speed use the sensor's poses." if clip.poses is not None
        else "The sensor's poses are unknown: no world view, trails as the sensor saw them.",
    ]  # fmt: skip
    poses = None if clip.poses is None else pack(clip.poses.transpose(0, 2, 1), "float32")
    labels = pack_boxes("labels", clip.truth, clip.poses, [m for m, _ in found], (70, 214, 110))
    return {
        "frames": clip.num_frames,
        "first": first,
        "period": PERIOD,
        "speed": speed,
        "poses": poses,
        "points": points,
        "labels": labels if len(clip.truth) else None,
        "trackers": [
            pack_boxes(name, rows, clip.poses, [status])
            for (name, rows), (_, status) in zip(trackers.items(), found, strict=True)
        ],
        "network": None,
        "notes": notes,
    }


def _points(clip: Clip, limit: int, shading: str) -> tuple[dict[str, Any], list[str]]:
    frames, counts = [], []
    for t in range(clip.num_frames):
        points = clip.points(t)
        points = np.zeros((0, 4), np.float32) if points is None else points
        counts.append(len(points))
        points = thin(points, limit, t)
        if points.shape[1] == 3:
            shading = "one shade"
        elif shading == "intensity":  # most of a scan is dark: its square root tells more apart
            points = np.column_stack([points[:, :3], np.sqrt(np.abs(points[:, 3]))])
        frames.append(pack_points(points))
    most = max(counts)
    kept = f"{limit} of up to {most}, drawn at random" if most > limit else f"all, up to {most}"
    shaded = "" if shading == "one shade" else f"; brighter is more {shading}"
    note = f"Points of a frame: {kept}; rounded to {100 * STEP:g} cm{shaded}. Rings: every 20 m."
    bright = BRIGHT.get(shading, BRIGHT["intensity"])
    colors = np.linspace(DIM, bright, 256).round().astype(int).tolist()
    return {"step": STEP, "frames": frames, "colors": colors, "shading": shading}, [note]


def _rgb(color: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(color[1:]))
