"""Labelled, detected or tracked objects of one sequence, as arrays over rows."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from kitti.boxes import observation_angle

CLASSES = (
    "Car",
    "Van",
    "Truck",
    "Pedestrian",
    "Person",
    "Person_sitting",
    "Cyclist",
    "Tram",
    "Misc",
    "DontCare",
)
"""Type names of the benchmark; sitting persons are `Person` in the labels, `Person_sitting` in
the devkit's text."""
_BY_LOWER_CASE = {name.lower(): name for name in CLASSES}
VEHICLES = ("Car", "Van")
"""The classes that the paper counts as vehicles (636 trajectories)."""

NO_ANGLE = -10.0
"""KITTI's value of alpha for a row without a 3-D box."""

_DTYPES = {
    "frame": np.int32,
    "track_id": np.int64,
    "type": "<U16",
    "truncation": np.float32,
    "occlusion": np.int32,
    "alpha": np.float64,
    "bbox": np.float64,
    "boxes": np.float64,
    "score": np.float64,
}
_WIDTHS = {"bbox": 4, "boxes": 7}


def class_name(text: str) -> str:
    """The benchmark's spelling of a class written in any case; `text` itself if it is unknown."""
    return _BY_LOWER_CASE.get(text.lower(), text)


@dataclass(frozen=True, eq=False)
class Objects:
    """R rows of a label, result or detection file, as parallel arrays.

    Attributes:
        frame: (R,) int32, from 0.
        track_id: (R,) int64; -1 for DontCare and for detections.
        type: (R,) <U16, one of `CLASSES`.
        truncation: (R,) float32; KITTI tracking: 0 none, 1 partly, 2 largely; -1 unknown.
        occlusion: (R,) int32; 0 visible, 1 partly, 2 largely, 3 unknown; -1 where not given.
        alpha: (R,) float64 observation angle in radians; -10 where not given.
        bbox: (R, 4) float64 x1, y1, x2, y2 in pixels of the left colour image.
        boxes: (R, 7) float64 boxes of the level frame; NaN where a row has none (DontCare).
        score: (R,) float64; NaN where a row has none.
    """

    frame: np.ndarray
    track_id: np.ndarray
    type: np.ndarray
    truncation: np.ndarray
    occlusion: np.ndarray
    alpha: np.ndarray
    bbox: np.ndarray
    boxes: np.ndarray
    score: np.ndarray

    def __post_init__(self):
        rows = len(self.frame)
        for name, dtype in _DTYPES.items():
            shape = (rows, _WIDTHS[name]) if name in _WIDTHS else (rows,)
            value = np.asarray(getattr(self, name), dtype)
            if value.shape != shape:
                raise ValueError(f"Objects.{name}: expected shape {shape}, found {value.shape}")
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, index: np.ndarray | slice) -> "Objects":
        """The rows chosen by a mask, an index array or a slice."""
        chosen = object.__new__(Objects)  # the arrays are checked already
        for name in _DTYPES:
            object.__setattr__(chosen, name, getattr(self, name)[index])
        return chosen

    @cached_property
    def _in_order(self) -> bool:
        return bool((np.diff(self.frame) >= 0).all())

    def at(self, frame: int) -> "Objects":
        """The rows of one frame, in file order; fast where the rows are sorted by frame."""
        if not self._in_order:
            return self[self.frame == frame]
        first, last = np.searchsorted(self.frame, (frame, frame + 1))
        return self[first:last]

    def of_classes(self, classes: Sequence[str]) -> "Objects":
        """The rows whose type is one of `classes`."""
        chosen = np.zeros(len(self), bool)
        for name in classes:
            chosen |= self.type == name
        return self[chosen]

    @staticmethod
    def empty() -> "Objects":
        """No rows."""
        return Objects(
            **{name: np.zeros((0, _WIDTHS[name]) if name in _WIDTHS else 0) for name in _DTYPES}
        )

    @staticmethod
    def concatenate(parts: Iterable["Objects"]) -> "Objects":
        """All rows of `parts` in order."""
        parts = [Objects.empty(), *parts]
        return Objects(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Objects)}
        )

    @staticmethod
    def from_boxes(
        frame: np.ndarray | int,
        track_id: np.ndarray | int,
        boxes: np.ndarray,
        score: np.ndarray | float = np.nan,
        *,
        kind: np.ndarray | str = "Car",
        bbox: np.ndarray | None = None,
    ) -> "Objects":
        """Rows for (R, 7) level boxes; scalars hold for all rows.

        `bbox` (R, 4) is as `project_boxes` gives it; NaN rows, and all rows if it is None, are
        written as -1 -1 -1 -1. Truncation and occlusion are not given (-1).
        """
        boxes = np.asarray(boxes, np.float64).reshape(-1, 7)
        rows = len(boxes)
        bbox = np.full((rows, 4), np.nan) if bbox is None else bbox
        return Objects(
            frame=np.broadcast_to(frame, rows),
            track_id=np.broadcast_to(track_id, rows),
            type=np.broadcast_to(kind, rows),
            truncation=np.full(rows, -1),
            occlusion=np.full(rows, -1),
            alpha=np.nan_to_num(observation_angle(boxes), nan=NO_ANGLE),
            bbox=np.where(np.isnan(bbox), -1.0, bbox),
            boxes=boxes,
            score=np.broadcast_to(score, rows),
        )
