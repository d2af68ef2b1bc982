"""A drive as data of the 3-D scene: points, boxes with ids and speeds, errors per frame.

Letters: F frames, R rows of boxes.
"""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from kitti.iou import iou_3d
from kitti.objects import VEHICLES, Objects
from metrics.clear3d import row_errors
from metrics.comparison import compare
from visualization.clip import Clip
from visualization.drawing import ON_DARK, id_color
from visualization.scene_points import POINTS_PER_FRAME, ScenePoints

PERIOD = 0.1  # seconds between two frames: KITTI's scanner turns ten times a second
MATCHED, FALSE_ALARM, SWITCH, NOT_EVALUATED = 0, 1, 2, -1


def pack(values: Any, dtype: str) -> dict[str, str]:
    """Encodes an array for the page: {"type", "data" in base64, little-endian}."""
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


def errors_of(
    truth: Objects, results: Objects, num_frames: int, min_iou: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors as counted by `clear3d` of evaluate.py: (R,) bool misses, (S,) int8 of results.

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
    name: str, objects: Objects, clip: Clip, errors: list[np.ndarray], color=None
) -> dict[str, Any]:
    """Rows of boxes, their speeds and colours; frames count from the clip's first.

    errors: (R,) arrays of small integers.
    """
    types, kind = np.unique(objects.type, return_inverse=True)
    track = tracks_of(objects)
    ids = objects.track_id[np.unique(track, return_index=True)[1]].tolist()
    return {
        "name": name,
        "frame": pack(objects.frame - clip.frames.start, "int32"),
        "track": pack(track, "int32"),
        "ids": [str(i) for i in ids],
        "types": types.tolist(),
        "type": pack(kind, "uint8"),
        "score": pack(objects.score, "float32"),
        "speed": pack(speeds(objects, clip.poses), "float32"),
        "box": pack(objects.boxes, "float32"),
        "errors": [pack(values, "int8") for values in errors],
        "colors": [_rgb(id_color(i, ON_DARK)) if color is None else color for i in ids],
    }


def scene_data(
    clip: Clip,
    trackers: Mapping[str, Objects],
    *,
    min_iou: float = 0.5,
    shading: str = "intensity",
    points_per_frame: int = POINTS_PER_FRAME,
    points: ScenePoints | None = None,
) -> dict[str, Any]:
    """The scene, JSON-ready.

    Args:
        clip: scans, labels and poses; its own results are not used.
        trackers: name -> rows of a result file, in the order of the panel.
        min_iou: least 3-D IoU of a match, as in evaluate.py.
        shading: meaning of the points' fourth column, a key of `BRIGHT`.
        points_per_frame: at most so many points of a frame are kept; long drives keep fewer.
        points: of all frames, shown in place of the clip's.
    """
    trackers = {name: rows[np.isfinite(rows.boxes).all(axis=1)] for name, rows in trackers.items()}
    found = [errors_of(clip.truth, rows, clip.frames.stop, min_iou) for rows in trackers.values()]
    if points is None:
        points = ScenePoints(len(clip.frames), shading, points_per_frame)
        for i, t in enumerate(clip.frames):
            points.put(i, clip.points(t))
    speed = "speed" if clip.poses is not None else "speed relative to the sensor"
    notes = [
        f"{points.note()} Rings: every 20 m.",
        f"Labels, where there are any, and tracks in the sensor's level frame; {speed} from "
        f"central differences, {1 / PERIOD:g} frames a second.",
        f"Errors: clear3d of evaluate.py, classes {', '.join(VEHICLES)}, 3-D IoU at least "
        f"{min_iou:g}." if len(clip.truth) else "No labels: errors are unknown.",
        "World view and ground speed use the sensor's poses." if clip.poses is not None
        else "The sensor's poses are unknown: no world view, trails in the sensor's frame.",
    ]  # fmt: skip
    poses = None
    if clip.poses is not None:
        shown = clip.poses[clip.frames.start : clip.frames.stop]
        poses = pack(shown.transpose(0, 2, 1), "float32")
    labels = pack_boxes("labels", clip.truth, clip, [m for m, _ in found], (70, 214, 110))
    return {
        "frames": len(clip.frames),
        "first": clip.frames.start,
        "period": PERIOD,
        "speed": speed,
        "poses": poses,
        "points": points.data(),
        "labels": labels if len(clip.truth) else None,
        "trackers": [
            pack_boxes(name, rows, clip, [status])
            for (name, rows), (_, status) in zip(trackers.items(), found, strict=True)
        ],
        "network": None,
        "notes": notes,
    }


def _rgb(color: str) -> tuple[int, ...]:
    return tuple(bytes.fromhex(color[1:]))
