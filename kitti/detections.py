"""Detections: one file per sequence (AB3DMOT's, or KITTI results), or one per frame."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.notes import note
from kitti.boxes import level_from_camera
from kitti.labels import (
    LABEL_COLUMNS,
    RESULT_COLUMNS,
    Limit,
    check_boxes,
    frames_of,
    known_classes,
    read_results,
    refuse_magnitudes,
    sorted_by_frame,
)
from kitti.objects import CLASSES, Objects, class_name
from kitti.tables import Table, columns_of, read_lines, read_table, sequence_file

DETECTION_COLUMNS = 15
OBJECT_COLUMNS = (15, 16, 17)
"""Of the object benchmark's files: type, truncation, occlusion, alpha, 2-D box, h w l, x y z, ry,
and optionally a score; AB3DMOT's tracks have an id behind it, which is not used."""
DETECTION_TYPES = {1: "Pedestrian", 2: "Car", 3: "Cyclist"}
"""Type numbers of AB3DMOT's detection files."""
_EXPECTED = (
    f"expected {DETECTION_COLUMNS} columns (AB3DMOT: frame, type, ...), {LABEL_COLUMNS} or "
    f"{RESULT_COLUMNS} (KITTI results: frame, id, class, ...)"
)
_FRAME_FILE = re.compile(r"(\d+)\.txt", re.ASCII)
_LONG_FRAME_FILE = re.compile(r"(\d{6,})\.txt", re.ASCII)  # four digits are a sequence


def read_detection_folder(
    folder: str | Path, name: str, num_frames: int | None = None, alone: bool = False
) -> Objects:
    """The detections of sequence `name` in a folder.

    They are in the file of `sequence_file`, in AB3DMOT's layout or as KITTI results, or in files
    `000000.txt`, a frame each, in the object benchmark's layout, below `folder/NAME/`,
    `folder/NAME/data/`, or, where `alone`, `folder/` or `folder/data/` (six digits or more).

    Args:
        folder: of the files.
        name: of the sequence, such as 0016.
        num_frames: frames of the sequence.
        alone: no other sequence is read from this folder.

    Raises:
        InputError: no such file, or as `read_detections` and `read_object_detections`.
    """
    path = sequence_file(folder, name)
    if os.path.lexists(path):
        return read_detections(path, num_frames)
    places = [(Path(folder) / name, _FRAME_FILE)]
    if alone:
        places.append((Path(folder), _LONG_FRAME_FILE))
    for parent, names in places:
        for below in (parent / "data", parent):
            if below.is_dir() and any(names.fullmatch(file.name) for file in below.iterdir()):
                return read_object_detections(below, num_frames, names)
    raise InputError(
        f"expected {name}.txt (AB3DMOT's layout or KITTI results) or {name}/000000.txt and so on "
        "(the object benchmark's layout)",
        folder,
    )


def read_detections(path: str | Path, num_frames: int | None = None) -> Objects:
    """Reads detections in AB3DMOT's layout, or those of a KITTI result file; empty means none.

    The number of columns tells which. AB3DMOT's 15: frame, type number (or class), x1, y1, x2, y2,
    score, h, w, l, x, y, z, ry, alpha. Track ids are -1.

    Raises:
        InputError: as `kitti.labels.read_labels`.
    """
    lines = read_lines(path)
    first = next((i for i, line in enumerate(lines) if line.strip()), None)
    columns = [] if first is None else columns_of(lines[first])
    if len(columns) in (LABEL_COLUMNS, RESULT_COLUMNS):
        rows = read_results(path, num_frames, tracked=False)
        boxed = ~np.isnan(rows.boxes).any(axis=1)  # no row of DontCare is
        left_out = ~boxed & (rows.type != "DontCare")
        if left_out.any():
            note(f"{path}: {left_out.sum()} of {len(rows)} rows have no 3-D box and are left out")
        return replace(rows[boxed], track_id=np.full(int(boxed.sum()), -1))
    if first is not None and (len(columns) != DETECTION_COLUMNS or columns[0].isidentifier()):
        hint = ""
        if class_name(columns[0]) in CLASSES:
            hint = f"; a file without frame numbers is one frame: {Path(path).stem}/000000.txt"
        found = f"found {len(columns)}: {columns[0]} ..."
        raise InputError(f"{_EXPECTED}, {found}{hint}", path, first + 1)
    named = len(columns) > 1 and columns[1].strip().isidentifier()
    table = read_table(path, (DETECTION_COLUMNS,), 1 if named else None)
    frame = frames_of(table, num_frames)
    kind = known_classes(table, 1) if named else _numbered_classes(table)
    values = table.numbers(2, DETECTION_COLUMNS)
    check_boxes(table, values[:, 5:12], kind, np.ones(len(table), bool), 8)
    refuse_magnitudes(table, np.delete(values, 4, axis=1), values[:, 4])
    return sorted_by_frame(
        Objects(
            frame=frame,
            track_id=np.full(len(table), -1),
            type=kind,
            truncation=np.full(len(table), -1),
            occlusion=np.full(len(table), -1),
            alpha=values[:, 12],
            bbox=values[:, :4],
            boxes=level_from_camera(*values[:, 5:12].T),
            score=values[:, 4],
        )
    )


def _numbered_classes(table: Table) -> np.ndarray:
    number = table.integers(1, "type number")
    known = " ".join(f"{key} ({name})" for key, name in DETECTION_TYPES.items())
    table.refuse(
        ~np.isin(number, list(DETECTION_TYPES)), f"column 2: expected one of the types {known}"
    )
    return np.array([DETECTION_TYPES.get(key, "") for key in range(4)])[number]


def read_object_detections(
    folder: str | Path, num_frames: int | None = None, names: re.Pattern[str] = _FRAME_FILE
) -> Objects:
    """Reads files `000000.txt` in the object benchmark's layout; a missing file has no detection.

    Track ids are -1; without a score column scores are NaN; rows of DontCare are omitted.

    Args:
        folder: of the files.
        num_frames: frames of the sequence.
        names: of the files, the frame in the first group; other files are ignored.

    Raises:
        InputError: as `kitti.labels.read_labels`, or two files of one frame, or a frame beyond
            `num_frames`.
    """
    files: dict[int, Path] = {}
    for path in sorted(Path(folder).iterdir()):
        match = names.fullmatch(path.name)
        if match is None:
            continue
        frame = int(match[1])
        if frame in files:
            raise InputError(f"frame {frame} is there twice: {files[frame].name}", path)
        if num_frames is not None and frame >= num_frames:
            limit = Limit(num_frames)
            last = f"expected 0 to {limit - 1}{limit.reason}"
            raise InputError(f"frame beyond the sequence, {last}", path)
        files[frame] = path
    if files and num_frames is not None and len(files) < num_frames:
        without = f"{num_frames - len(files)} of {num_frames} frames have no file"
        note(f"{folder}: {without}, and so no detection")
    parts = [_object_file(path, frame) for frame, path in sorted(files.items())]
    return Objects.concatenate(parts)


def _object_file(path: Path, frame: int) -> Objects:
    table = read_table(path, OBJECT_COLUMNS, text_column=0)
    kind, values = known_classes(table, 0), table.numbers(1, table.width)
    cared_for = kind != "DontCare"
    score = values[:, 14] if table.width > min(OBJECT_COLUMNS) else np.full(len(table), np.nan)
    check_boxes(table, values[:, 7:14], kind, cared_for, 9)
    refuse_magnitudes(table, values[:, :14], score)
    rows = Objects(
        frame=np.full(len(table), frame),
        track_id=np.full(len(table), -1),
        type=kind,
        truncation=values[:, 0],
        occlusion=table.integers(2, "occlusion state"),
        alpha=values[:, 2],
        bbox=values[:, 3:7],
        boxes=level_from_camera(*values[:, 7:14].T),
        score=score,
    )
    return rows[cared_for]
