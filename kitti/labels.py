"""Label files (17 columns) and result files (18)."""

from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import write_text
from common.notes import note
from kitti.boxes import camera_from_level, level_from_camera
from kitti.objects import CLASSES, Objects, class_name
from kitti.tables import Table, read_table

LABEL_COLUMNS = 17
RESULT_COLUMNS = 18
TYPE_COLUMN = 2
MAX_FRAMES = 100_000
"""Most frames of a sequence; KITTI's longest has 1176."""
MIN_SIZE, MAX_SIZE, MAX_NUMBER, MAX_SCORE = 1e-3, 1e3, 1e7, 1e12
"""Bounds of box sizes (metres), coordinates (metres, pixels) and scores: beyond them a number is an
error of the input, is lost in the decimals of a result file, overflows, or fails in Shapely."""
MAX_HEADING = 4 * np.pi
"""Bound of headings in radians, which trackers may leave unwrapped; degrees are beyond it."""
_LONG = ("Car", "Van", "Truck")  # longer than high

# Values that mean "no 3-D box", h w l x y z ry: in KITTI's labels; in results of 2-D trackers.
_NO_BOX_LABEL = (-1000.0, -1000.0, -1000.0, -10.0, -1.0, -1.0, -1.0)
_NO_BOX_RESULT = (-1.0, -1.0, -1.0, -1000.0, -1000.0, -1000.0, -10.0)
_NO_SIZE = (-1.0, 0.0, -1000.0)  # as h, w and l


class Limit(int):
    """A number of frames with its origin, for messages: `Limit(5, "where ... end")`."""

    origin: str

    def __new__(cls, frames: int, origin: str = "") -> "Limit":
        """Args: frames: their number; origin: source of that number."""
        made = super().__new__(cls, frames)
        made.origin = getattr(frames, "origin", origin)
        return made

    @property
    def reason(self) -> str:
        """The origin of the limit and the way to more frames, in parentheses; empty if unknown."""
        return f", {self.origin}; a seqmap sets the frames, see docs/DATA.md" if self.origin else ""


def read_labels(path: str | Path, num_frames: int | None = None) -> Objects:
    """Reads `label_02/00XX.txt`; rows are sorted by frame (stably), scores are NaN.

    Args:
        path: the file; white space between 17 columns.
        num_frames: frames of the sequence, where they are known (seqmap). Without it a file
            without rows is an error, since the labels then define the number of frames.

    Raises:
        InputError: names file, line and expectation wherever the file deviates from KITTI's format.
    """
    table = read_table(path, (LABEL_COLUMNS,), text_column=TYPE_COLUMN)
    if not len(table) and num_frames is None:
        raise InputError("is empty, expected label rows of 17 columns", path)
    return _objects(table, num_frames, np.zeros(len(table), bool))


def read_results(path: str | Path, num_frames: int | None = None, tracked: bool = True) -> Objects:
    """Reads a tracker's result file: label columns and a score; empty means no tracks.

    Files without a score column are accepted, as in the devkit: scores are NaN. Rows of 2-D
    trackers (h w l of -1 -1 -1, 0 0 0 or -1000 -1000 -1000) get a NaN box. Track ids are
    required, each once per class in a frame, unless `tracked` is False (detections).

    Raises:
        InputError: as `read_labels`.
    """
    table = read_table(path, (LABEL_COLUMNS, RESULT_COLUMNS), text_column=TYPE_COLUMN)
    sizes = table.numbers(10, 13)
    boxless = np.isin(sizes[:, 0], _NO_SIZE) & (sizes == sizes[:, :1]).all(axis=1)
    return _objects(table, num_frames, boxless, tracked)


def _objects(
    table: Table, num_frames: int | None, boxless: np.ndarray, tracked: bool = True
) -> Objects:
    frame, track_id = frames_of(table, num_frames), table.integers(1, "track id", bits=64)
    kind = known_classes(table, 2)
    occlusion = table.integers(4, "occlusion state")
    truncation = table.numbers(3, 4)[:, 0]
    values = table.numbers(5, table.width)
    cared_for = kind != "DontCare"
    if tracked:
        table.refuse(cared_for & (track_id < 0), "column 2: expected a track id >= 0")
        track_id[~cared_for] = -1
    has_box = cared_for & ~boxless
    check_boxes(table, values[:, 5:12], kind, has_box, 11)
    scored = values.shape[1] == RESULT_COLUMNS - 5
    score = values[:, 12] if scored else np.full(len(table), np.nan)
    refuse_magnitudes(table, np.column_stack([truncation, values[:, :12]]), score)
    table.refuse(
        (values[:, 3:5] < values[:, 1:3]).any(axis=1), "columns 7-10: expected x1 <= x2, y1 <= y2"
    )
    if tracked:
        track_id = _unique_ids(table, frame, kind, track_id)
    boxes = level_from_camera(*values[:, 5:12].T)
    boxes[~has_box] = np.nan
    return sorted_by_frame(
        Objects(
            frame=frame,
            track_id=track_id,
            type=kind,
            truncation=truncation,
            occlusion=occlusion,
            alpha=values[:, 0],
            bbox=values[:, 1:5],
            boxes=boxes,
            score=score,
        )
    )


def known_classes(table: Table, column: int) -> np.ndarray:
    """The text column as (R,) names of `CLASSES`, in any case; refuses other names."""
    kind = np.array([class_name(name) for name in table.text.tolist()], "<U16")
    unknown = ~np.isin(kind, CLASSES)
    if unknown.any():
        row = int(np.argmax(unknown))
        expected = f"expected one of {' '.join(CLASSES)}"
        raise table.error(f"column {column + 1}: unknown class {str(kind[row])!r}, {expected}", row)
    return kind


def check_boxes(
    table: Table, camera: np.ndarray, kind: np.ndarray, has_box: np.ndarray, column: int
) -> None:
    """Refuses boxes h w l x y z ry (R, 7) that are none; notes vehicles that are higher than long.

    kind: (R,) classes; has_box: (R,) the rows to check; column: 1-based, of h in the file.
    """
    sizes, where = camera[:, :3], f"columns {column}-{column + 2}: expected sizes h w l"
    table.refuse(has_box & (sizes <= 0).any(axis=1), f"{where} above 0")
    small = has_box & (sizes < MIN_SIZE).any(axis=1)
    table.refuse(small, f"{where} of at least {MIN_SIZE} metres")
    large = has_box & (sizes > MAX_SIZE).any(axis=1)
    table.refuse(large, f"{where} of at most {MAX_SIZE:.0f} metres")
    turned = has_box & (np.abs(camera[:, 6]) > MAX_HEADING)
    table.refuse(turned, f"column {column + 6}: expected a heading in radians, -pi to pi")
    long = has_box & np.isin(kind, _LONG)
    if long.any() and np.median(camera[long, 0] - camera[long, 2]) > 0:
        note(f"{table.path}: vehicles are higher than long; {where}, in this order")


def refuse_magnitudes(table: Table, values: np.ndarray, score: np.ndarray) -> None:
    """Refuses numbers (R, C) beyond `MAX_NUMBER` and scores (R,) beyond `MAX_SCORE`."""
    beyond = (np.abs(values) > MAX_NUMBER).any(axis=1)
    table.refuse(beyond, f"expected numbers of magnitude {MAX_NUMBER:.0e} at most")
    table.refuse(
        np.abs(score) > MAX_SCORE, f"expected a score of magnitude {MAX_SCORE:.0e} at most"
    )


def frames_of(table: Table, num_frames: int | None) -> np.ndarray:
    """Column 1 as (R,) frame numbers; refuses those outside 0 to `num_frames` - 1."""
    frame = table.integers(0, "frame number")
    table.refuse(frame < 0, "column 1: expected a frame number >= 0")
    limit = Limit(MAX_FRAMES) if num_frames is None else Limit(num_frames)
    beyond = f"column 1: frame beyond the sequence, expected 0 to {limit - 1}{limit.reason}"
    table.refuse(frame >= limit, beyond)
    return frame


def _unique_ids(
    table: Table, frame: np.ndarray, kind: np.ndarray, track_id: np.ndarray
) -> np.ndarray:
    """Ids (R,) that are unique within each frame.

    An id may occur once per class in a frame, since KITTI evaluates one class at a time. In that
    case ids are renumbered, and such an id has one number for each of its classes.
    """
    rows = np.flatnonzero(track_id >= 0)
    order = rows[np.lexsort((kind[rows], track_id[rows], frame[rows]))]
    first, second = order[:-1], order[1:]
    same = (frame[first] == frame[second]) & (track_id[first] == track_id[second])
    again = second[same & (kind[first] == kind[second])]
    if len(again):
        row = int(again.min())
        raise table.error(
            f"frame {frame[row]} has track id {track_id[row]} twice as {kind[row]}, "
            "expected it once",
            row,
        )
    if not same.any():
        return track_id
    note(f"{table.path}: a track id belongs to two classes in a frame; all ids are renumbered")
    kind = np.where(np.isin(track_id, track_id[first[same]]), kind, "")
    pairs = np.array(list(zip(kind.tolist(), track_id.tolist(), strict=True)), "<U16,i8")
    numbers = track_id.copy()
    numbers[rows] = np.unique(pairs[rows], return_inverse=True)[1]
    return numbers


def sorted_by_frame(objects: Objects) -> Objects:
    """The rows by frame, those of a frame in their order."""
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
