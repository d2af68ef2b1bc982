"""SORT (Bewley et al., ICIP 2016), on 3-D boxes of the level frame.

Constant-velocity Kalman filter, Hungarian assignment on the IoU with the predicted boxes, and a
short probation; no appearance, no motion of the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kitti.iou import iou_3d
from tracking.assignment import hungarian
from tracking.box_filter import BoxFilter, Noise
from tracking.interface import Tracks, check_boxes
from tracking.life_cycle import LifeCycle


@dataclass(frozen=True)
class SortParameters:
    """SORT's own defaults (the values its authors published with the paper)."""

    min_iou: float = 0.3  # "IOU_min", section III.C
    max_age: int = 1  # "T_Lost = 1 in all experiments", section III.D
    min_hits: int = 3  # probation in frames, section III.D; the authors' default is 3
    noise: Noise = Noise()


class Sort:
    """SORT for one sequence."""

    def __init__(self, parameters: SortParameters | None = None):
        self.parameters = parameters or SortParameters()
        self.life = LifeCycle()

    def predict(self) -> None:
        """Kalman prediction of every track."""
        self.life.begin_frame()
        for track in self.life.tracks:
            track.state.predict()

    def update(self, boxes, scores, *, frame: int | None = None, **_unused) -> Tracks:
        """See `Tracker.update`."""
        boxes, scores = check_boxes(boxes, scores, frame)
        tracks, p = self.life.tracks, self.parameters
        predicted = np.array([track.state.box for track in tracks]).reshape(-1, 7)
        matching = hungarian(1.0 - iou_3d(predicted, boxes), 1.0 - p.min_iou)
        for row, column in matching.pairs:
            tracks[row].state.update(boxes[column])
            self.life.hit(tracks[row], scores[column], column)
        for column in matching.unmatched_columns:
            self.life.birth(BoxFilter(boxes[column], p.noise), scores[column], column)
        self.life.bury(lambda track: track.time_since_update > p.max_age)
        return self.life.report(self._is_shown, lambda track: boxes[track.detection])

    def _is_shown(self, track) -> bool:
        settled = track.hit_streak >= self.parameters.min_hits
        return track.detection >= 0 and (
            settled or self.life.frame_count <= self.parameters.min_hits
        )
