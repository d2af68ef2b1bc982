"""Label files (17 columns), result files (18), and detections in AB3DMOT's layout (15)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import write_text
from kitti.boxes import camera_from_level, level_from_camera
from kitti.objects import CLASSES, VEHICLES, Objects
from kitti.tables import Table, read_table

__all__ = [
    "CLASSES",
    "VEHICLES",
    "Objects",
    "read_detections",
    "read_labels",
    "read_results",
    "write_labels",
    "write_results",
]

LABEL_COLUMNS = 17
RESULT_COLUMNS = 18
DETECTION_COLUMNS = 15
TYPE_COLUMN = 2
MAX_FRAMES = 10**6
"""Frame numbers have six digits in KITTI's file names."""
DETECTION_TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
"""Type numbers of AB3DMOT's detection files."""

# What stands for "no 3-D box", as h w l x y z ry: in KITTI's labels; in results of 2-D trackers.
_NO_BOX_LABEL = (-1000.0, -1000.0, -1000.0, -10.0, -1.0, -1.0, -1.0)
_NO_BOX_RESULT = (-1.0, -1.0, -1.0, -1000.0, -1000.0, -1000.0, -10.0)


def read_labels(path: str | Path, num_frames: int | None = None) -> Objects:
    """Reads `label_02/00XX.txt`; rows are sorted by frame (stably), scores are NaN.

    Args:
        path: the file; white space between 17 columns.
        num_frames: frames of the sequence, where they are known (seqmap). Without it a file
            with no row is an error, since the labels then have to say how many frames there are.

    Raises:
        InputError: naming file, line and expectation, for anything that is not as KITTI has it.
    """
    table = read_table(path, (LABEL_COLUMNS,), text_column=TYPE_COLUMN)
    if not len(table) and num_frames is None:
        raise InputError("is empty, expected label rows of 17 columns", path)
    return _objects(table, num_frames)


def read_results(path: str | Path, num_frames: int | None = None) -> Objects:
    """Reads a tracker's result file: label columns and a score; empty means no tracks.

    A file whose rows all lack the score is read too (the devkit allows it): scores are NaN.
    Rows of 2-D trackers (-1 -1 -1 -1000 -1000 -1000 -10) get a NaN box.

    Raises:
        InputError: as `read_labels`.
    """
    widths = (LABEL_COLUMNS, RESULT_COLUMNS)
    return _objects(read_table(path, widths, text_column=TYPE_COLUMN), num_frames)


def read_detections(path: str | Path, num_frames: int | None = None) -> Objects:
    """Reads detections in AB3DMOT's layout; empty means none.

    Columns, separated by commas: frame, type number, x1, y1, x2, y2, score, h, w, l, x, y, z,
    ry, alpha. Track ids are -1.

    Raises:
        InputError: as `read_labels`.
    """
    table = read_table(path, (DETECTION_COLUMNS,), ",")
    frame = _frames(table, num_frames)
    number = table.integers(1, "type number")
    known = " ".join(f"{key} ({name})" for key, name in DETECTION_TYPES.items())
    table.refuse(
        ~np.isin(number, list(DETECTION_TYPES)), f"column 2: expected one of the types {known}"
    )
    values = table.numbers(2, DETECTION_COLUMNS)
    table.refuse((values[:, 5:8] <= 0).any(axis=1), "columns 8-10: expected sizes h w l above 0")
    names = np.array([DETECTION_TYPES.get(key, "") for key in range(4)])
    return _sorted(
        Objects(
            frame=frame,
            track_id=np.full(len(table), -1),
            type=names[number],
            truncation=np.full(len(table), -1),
            occlusion=np.full(len(table), -1),
            alpha=values[:, 12],
            bbox=values[:, :4],
            boxes=level_from_camera(*values[:, 5:12].T),
            score=values[:, 4],
        )
    )


def _objects(table: Table, num_frames: int | None) -> Objects:
    frame, track_id = _frames(table, num_frames), table.integers(1, "track id")
    kind = table.text
    unknown = set(np.unique(kind).tolist()) - set(CLASSES)
    if unknown:
        row = int(np.argmax(np.isin(kind, list(unknown))))
        raise table.error(
            f"column 3: unknown class {str(kind[row])!r}, expected one of {' '.join(CLASSES)}", row
        )
    occlusion = table.integers(4, "occlusion state")
    truncation = table.numbers(3, 4)[:, 0]
    values = table.numbers(5, table.width)
    cared_for = kind != "DontCare"
    table.refuse(cared_for & (track_id < 0), "column 2: expected a track id >= 0")
    has_box = cared_for & ~(values[:, 5:12] == _NO_BOX_RESULT).all(axis=1)
    table.refuse(
        has_box & (values[:, 5:8] <= 0).any(axis=1), "columns 11-13: expected sizes h w l above 0"
    )
    table.refuse(
        (values[:, 3:5] < values[:, 1:3]).any(axis=1), "columns 7-10: expected x1 <= x2, y1 <= y2"
    )
    _refuse_duplicates(table, frame, track_id)
    boxes = level_from_camera(*values[:, 5:12].T)
    boxes[~has_box] = np.nan
    scored = values.shape[1] == RESULT_COLUMNS - 5
    return _sorted(
        Objects(
            frame=frame,
            track_id=track_id,
            type=kind,
            truncation=truncation,
            occlusion=occlusion,
            alpha=values[:, 0],
            bbox=values[:, 1:5],
            boxes=boxes,
            score=values[:, 12] if scored else np.full(len(table), np.nan),
        )
    )


def _frames(table: Table, num_frames: int | None) -> np.ndarray:
    frame = table.integers(0, "frame number")
    table.refuse(frame < 0, "column 1: expected a frame number >= 0")
    limit = MAX_FRAMES if num_frames is None else num_frames
    beyond = f"column 1: frame beyond the sequence, expected 0 to {limit - 1}"
    table.refuse(frame >= limit, beyond)
    return frame


def _refuse_duplicates(table: Table, frame: np.ndarray, track_id: np.ndarray) -> None:
    key = frame.astype(np.int64) << 32 | track_id.astype(np.int64)
    rows = np.flatnonzero(track_id >= 0)
    rows = rows[np.argsort(key[rows], kind="stable")]
    again = rows[1:][key[rows[1:]] == key[rows[:-1]]]
    if len(again):
        row = int(again.min())
        raise table.error(
            f"frame {frame[row]} has track id {track_id[row]} twice, expected it once", row
        )


def _sorted(objects: Objects) -> Objects:
    return objects if objects._in_order else objects[np.argsort(objects.frame, kind="stable")]


def write_labels(path: str | Path, objects: Objects) -> None:
    """Writes 17 columns, six decimals as KITTI does; rows without a box as KITTI's DontCare.

    Raises:
        ValueError: a number is infinite, or part of a box is NaN.
    """
    write_text(path, "".join(line + "\n" for line in _lines(objects, _NO_BOX_LABEL)))


def write_results(path: str | Path, objects: Objects) -> None:
    """Writes 18 columns (score last), six decimals; a NaN 2-D box as -1 -1 -1 -1.

    Raises:
        ValueError: a score is missing, or a number is not finite.
    """
    if not np.isfinite(objects.score).all():
        raise ValueError("expected a finite score in every row of a result file")
    lines = _lines(objects, _NO_BOX_RESULT)
    write_text(
        path,
        "".join(f"{line} {score:.6f}\n" for line, score in zip(lines, objects.score, strict=True)),
    )


def _lines(objects: Objects, no_box: tuple[float, ...]) -> list[str]:
    camera = np.stack(camera_from_level(objects.boxes), axis=1)
    camera[np.isnan(camera).all(axis=1)] = no_box
    bbox = np.nan_to_num(objects.bbox, nan=-1.0)
    reals = np.column_stack([objects.alpha, bbox, camera])
    if not np.isfinite(reals).all():
        row = int(np.argmax(~np.isfinite(reals).all(axis=1)))
        raise ValueError(f"row {row}: expected finite numbers to write, found {reals[row]}")
    heads = zip(
        objects.frame.tolist(),
        objects.track_id.tolist(),
        objects.type.tolist(),
        objects.truncation.tolist(),
        objects.occlusion.tolist(),
        strict=True,
    )
    form = "%d %d %s %.6g %d" + " %.6f" * 12
    return [form % (*head, *row) for head, row in zip(heads, reals.tolist(), strict=True)]
