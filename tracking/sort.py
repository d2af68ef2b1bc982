"""SORT (Bewley et al., ICIP 2016), on 3-D boxes of the level frame or on their image boxes.

Constant-velocity Kalman filter, Hungarian assignment on the IoU with the predicted boxes, and a
short probation; no appearance, no motion of the sensor. PointTrackNet's paper does not say in which
space it ran SORT; the level frame is the default, and README.md here compares the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.errors import InputError
from kitti.iou import iou_3d
from tracking.assignment import hungarian
from tracking.box_filter import BoxFilter, Noise
from tracking.image_filter import ImageFilter, iou_2d
from tracking.interface import Tracks, check_boxes
from tracking.life_cycle import LifeCycle, Track

SPACES = {"level": (BoxFilter, iou_3d, 7), "image": (ImageFilter, iou_2d, 4)}


@dataclass(frozen=True)
class SortParameters:
    """SORT's own defaults (the values its authors published with the paper)."""

    min_iou: float = 0.3  # "IOU_min", section III.C
    max_age: int = 1  # "T_Lost = 1 in all experiments", section III.D
    min_hits: int = 3  # matches of the probation, section III.D; the authors' default is 3
    noise: Noise = Noise()
    space: str = "level"  # or "image": needs `image_boxes`

    def __post_init__(self):
        if self.space not in SPACES:
            raise InputError(f"space: expected one of {', '.join(SPACES)}, found {self.space!r}")


class Sort:
    """SORT for one sequence."""

    def __init__(self, parameters: SortParameters | None = None):
        self.parameters = parameters or SortParameters()
        self.life = LifeCycle()
        self._filter, self._iou, self._size = SPACES[self.parameters.space]

    def predict(self) -> None:
        """Kalman prediction of every track."""
        self.life.begin_frame()
        for track in self.life.tracks:
            track.state.predict()

    def update(
        self,
        boxes,
        scores,
        *,
        image_boxes: np.ndarray | None = None,
        frame: int | None = None,
        **_unused,
    ) -> Tracks:
        """See `Tracker.update`. In image space a box outside the image is not tracked."""
        boxes, scores = check_boxes(boxes, scores, frame)
        measured, rows = self._measured(boxes, image_boxes)
        tracks, p = self.life.tracks, self.parameters
        predicted = np.array([track.state.box for track in tracks]).reshape(-1, self._size)
        matching = hungarian(1.0 - self._iou(predicted, measured), 1.0 - p.min_iou)
        for row, column in matching.pairs:
            tracks[row].state.update(measured[column])
            self.life.hit(tracks[row], scores[rows[column]], rows[column])
        for column in matching.unmatched_columns:
            state = self._filter(measured[column], p.noise)
            self.life.birth(state, scores[rows[column]], rows[column])
        self.life.bury(lambda track: track.time_since_update > p.max_age)
        return self.life.report(self._is_shown, lambda track: boxes[track.detection])

    def _measured(self, boxes, image_boxes) -> tuple[np.ndarray, np.ndarray]:
        """What is tracked, and the rows of `boxes` it comes from."""
        if self.parameters.space == "level":
            return boxes, np.arange(len(boxes))
        image_boxes = np.asarray(image_boxes, np.float64)
        if image_boxes.shape != (len(boxes), 4):
            raise InputError(f"expected image_boxes ({len(boxes)}, 4), found {image_boxes.shape}")
        extent = image_boxes[:, 2:] - image_boxes[:, :2]
        rows = np.flatnonzero((np.isfinite(extent) & (extent > 0)).all(axis=1))
        return image_boxes[rows], rows

    def _is_shown(self, track: Track) -> bool:
        """A settled track that was seen in this frame; in the first frames, any."""
        settled = track.hit_streak >= self.parameters.min_hits
        early = self.life.frame_count <= self.parameters.min_hits
        return track.detection >= 0 and (settled or early)
