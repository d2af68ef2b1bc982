"""What every tracker takes and gives: checked detections in, tracks to report out.

Letters: M detected boxes of this frame, T tracks, n points, C channels of an appearance vector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from common.errors import InputError

BOX_SIZE = 7  # x, y, z, l, w, h, yaw in the level frame

BoxDisplacement = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Tracks:
    """What is to be reported for one frame, ordered by id.

    Attributes:
        boxes: (T, 7) float64, level frame: x, y, z, l, w, h in metres, yaw in radians.
        ids: (T,) int64, from 0 within one tracker, never reused.
        scores: (T,) float64, the score of the detection that was matched last.
        detections: (T,) int64, row of this frame's detections that was matched, -1 for a lost
            object whose predicted box is reported.
    """

    boxes: np.ndarray
    ids: np.ndarray
    scores: np.ndarray
    detections: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)


class Tracker(Protocol):
    """One object per sequence; for each frame in turn `predict()`, then `update(...)`."""

    def predict(self) -> None:
        """Carries the tracks from frame t-1 to frame t, before frame t is looked at."""

    def update(
        self,
        boxes: np.ndarray,
        scores: np.ndarray,
        *,
        points: np.ndarray | None = None,
        displacement: np.ndarray | None = None,
        foreground: np.ndarray | None = None,
        box_displacement: BoxDisplacement | None = None,
        appearance: np.ndarray | None = None,
        ego_motion: np.ndarray | None = None,
        image_boxes: np.ndarray | None = None,
        ids: np.ndarray | None = None,
        frame: int | None = None,
    ) -> Tracks:
        """Associates the detections of frame t with the tracks; raises `InputError` on bad input.

        A tracker uses what its method uses and leaves the rest alone.

        Args:
            boxes: (M, 7) level frame.
            scores: (M,), higher is surer.
            points: (n, 3) points of frame t-1, level frame (Algorithm 1).
            displacement: (n, 3) predicted movement of each of them to frame t, metres.
            foreground: (n,) probability of each of them of being foreground; None: 1 everywhere.
            box_displacement: called with the boxes of t-1 (T, 7) and their label ids (T,), gives
                their movement to t (T, 3), NaN where unknown; instead of points (Algorithm 1).
            appearance: (M, C), a row of zeros for a box without one (DEEP_SORT).
            ego_motion: (4, 4) takes level-frame coordinates of t-1 to those of t (AB3DMOT).
            image_boxes: (M, 4) x1, y1, x2, y2 in pixels, NaN outside the image (SORT in image
                space).
            ids: (M,) label ids of the boxes, -1 for none; only handed to `box_displacement`.
            frame: number of the frame, for error messages.
        """


def check_boxes(boxes, scores, frame: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Detections as float64 (M, 7) and (M,); `InputError` unless finite with positive sizes."""
    where = "" if frame is None else f" in frame {frame}"
    boxes, scores = np.asarray(boxes, np.float64), np.asarray(scores, np.float64)
    if boxes.size == 0:
        boxes = boxes.reshape(0, BOX_SIZE)
    if boxes.ndim != 2 or boxes.shape[1] != BOX_SIZE:
        raise InputError(f"expected boxes of shape (M, 7){where}, found {boxes.shape}")
    if scores.shape != (len(boxes),):
        raise InputError(f"expected {len(boxes)} scores{where}, found shape {scores.shape}")
    bad = ~np.isfinite(boxes).all(axis=1) | ~np.isfinite(scores) | (boxes[:, 3:6] <= 0).any(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"expected finite boxes, positive sizes and finite scores{where}, "
            f"found row {row}: {boxes[row].tolist()} score {scores[row]}"
        )
    return boxes, scores


def check_rows(name: str, values, rows: int | None, columns: int | None = None) -> np.ndarray:
    """An argument as a finite float64 (rows, columns) array, or `InputError`; None means any."""
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
