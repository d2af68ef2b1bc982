"""The detections of one frame, the input of the trackers from networks, labels and files.

Letters: M detected boxes, n points, C channels of an appearance vector.
"""

from dataclasses import dataclass, replace

import numpy as np

from common.errors import InputError

BOX_SIZE = 7  # x, y, z, l, w, h, yaw in the level frame
FOREGROUND = 0.5  # least probability of a point in the foreground mask


@dataclass(frozen=True, eq=False)
class FrameDetections:
    """Boxes of frame t and the predicted motion from frame t-1, validated on construction.

    Attributes:
        t: frame number, from 0.
        boxes: (M, 7) float64, level frame, metres and radians.
        scores: (M,) float64, larger for a more certain box.
        types: (M,) class names; None becomes "Car".
        points: (n, 3) float64 points of frame t-1, level frame; None without a prediction.
        displacement: (n, 3) float64 predicted movement of `points` to frame t, metres.
        foreground: (n,) float64 foreground probability of `points`; None becomes 1 everywhere.
        mask: (k, 3) float64 points of frame t in the foreground mask, level frame; None if unknown.
        appearance: (M, C) float64, a row of zeros for a box without one; None if unknown.
        label_ids: (M,) int64 track ids of labelled boxes; None for detected ones.

    Boxes and scores are copied, so that a tracker keeps them while the caller fills its buffers
    anew.

    Raises:
        InputError: wrong shapes, NaN or infinity, or a box whose size is not positive.
    """

    t: int
    boxes: np.ndarray
    scores: np.ndarray
    types: np.ndarray | None = None
    points: np.ndarray | None = None
    displacement: np.ndarray | None = None
    foreground: np.ndarray | None = None
    mask: np.ndarray | None = None
    appearance: np.ndarray | None = None
    label_ids: np.ndarray | None = None

    def __post_init__(self):
        boxes, scores = _checked_boxes(self.boxes, self.scores, self.t)
        rows = len(boxes)
        self._set(boxes=boxes, scores=scores)
        types = np.broadcast_to("Car", rows) if self.types is None else np.asarray(self.types)
        self._set(types=_checked_column("types", types, rows))
        if self.points is not None:
            self._check_motion()
        if self.mask is not None:
            self._set(mask=checked_rows("mask", self.mask, None, 3))
        if self.appearance is not None:
            self._set(appearance=checked_rows("appearance", self.appearance, rows))
        if self.label_ids is not None:
            ids = np.asarray(self.label_ids, np.int64)
            self._set(label_ids=_checked_column("label_ids", ids, rows))

    def __len__(self) -> int:
        return len(self.boxes)

    def only(self, rows: np.ndarray) -> "FrameDetections":
        """The boxes of some rows, (M,) bool, with the same motion."""
        columns = {"boxes": self.boxes, "scores": self.scores, "types": self.types}
        columns |= {"appearance": self.appearance, "label_ids": self.label_ids}
        return replace(self, **{k: None if v is None else v[rows] for k, v in columns.items()})

    def _check_motion(self) -> None:
        points = checked_rows("points", self.points, None)
        count = len(points)
        foreground = np.ones(count) if self.foreground is None else self.foreground
        column = np.reshape(foreground, (-1, 1))
        self._set(
            points=points,
            displacement=checked_rows("displacement", self.displacement, count, 3),
            foreground=checked_rows("foreground", column, count, 1)[:, 0],
        )

    def _set(self, **values: np.ndarray) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)


def _checked_boxes(boxes, scores, t: int) -> tuple[np.ndarray, np.ndarray]:
    """(M, 7) and (M,) float64, finite, with positive sizes."""
    boxes, scores = np.array(boxes, np.float64), np.array(scores, np.float64)
    if boxes.size == 0:
        boxes = boxes.reshape(0, BOX_SIZE)
    if boxes.ndim != 2 or boxes.shape[1] != BOX_SIZE:
        raise InputError(f"expected boxes of shape (M, 7) in frame {t}, found {boxes.shape}")
    if scores.shape != (len(boxes),):
        raise InputError(f"expected {len(boxes)} scores in frame {t}, found shape {scores.shape}")
    bad = ~np.isfinite(boxes).all(axis=1) | ~np.isfinite(scores) | (boxes[:, 3:6] <= 0).any(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"expected finite boxes, positive sizes and finite scores in frame {t}, "
            f"found row {row}: {boxes[row].tolist()} score {scores[row]}"
        )
    return boxes, scores


def _checked_column(name: str, values: np.ndarray, rows: int) -> np.ndarray:
    """The array, if its shape is (rows,)."""
    if values.shape != (rows,):
        raise InputError(f"expected {name} of shape ({rows},), found {values.shape}")
    return values


def checked_rows(name: str, values, rows: int | None, columns: int | None = None) -> np.ndarray:
    """A finite float64 (rows, columns) array; None allows any number."""
    values = np.asarray(values, np.float64)
    if (
        values.ndim != 2
        or rows not in (None, len(values))
        or columns not in (None, values.shape[1])
    ):
        raise InputError(f"expected {name} of shape ({rows}, {columns}), found {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"expected finite {name}, found NaN or infinity")
    return values
