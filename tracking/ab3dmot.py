"""AB3DMOT (Weng et al., IROS 2020): 3-D Kalman filter, Hungarian assignment, birth and death.

Section and module names are the paper's. The published figures for PointRCNN cars were made with
GIoU in place of IoU and with the sensor's own motion taken out, so that is the default here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.errors import InputError
from kitti.iou import giou_3d, iou_3d
from tracking.assignment import hungarian
from tracking.box_filter import BoxFilter, Noise
from tracking.interface import Tracks, check_boxes, check_rows
from tracking.life_cycle import LifeCycle, Track

SIMILARITY = {"iou_3d": iou_3d, "giou_3d": giou_3d}


@dataclass(frozen=True)
class Ab3dmotParameters:
    """AB3DMOT's values for cars."""

    similarity: str = "giou_3d"  # or iou_3d; the authors' setting for PointRCNN cars
    min_similarity: float = -0.2  # the authors' GIoU setting; the paper's IoU_min is 0.01
    max_age: int = 2  # "Age_max = 2", section IV
    min_hits: int = 3  # "Bir_min = 3", section IV
    noise: Noise = Noise()  # section III.B and the authors' setting

    def __post_init__(self):
        if self.similarity not in SIMILARITY:
            raise InputError(f"expected one of {sorted(SIMILARITY)}, found {self.similarity!r}")


class Ab3dmot:
    """AB3DMOT for one sequence."""

    def __init__(self, parameters: Ab3dmotParameters | None = None):
        self.parameters = parameters or Ab3dmotParameters()
        self.life = LifeCycle()

    def predict(self) -> None:
        """(B) 3-D Kalman filter: state prediction."""
        self.life.begin_frame()
        for track in self.life.tracks:
            track.state.predict()

    def update(
        self,
        boxes,
        scores,
        *,
        ego_motion: np.ndarray | None = None,
        frame: int | None = None,
        **_unused,
    ) -> Tracks:
        """See `Tracker.update`."""
        boxes, scores = check_boxes(boxes, scores, frame)
        tracks, p = self.life.tracks, self.parameters
        if ego_motion is not None:
            motion = check_rows("ego_motion", ego_motion, 4, 4)
            for track in tracks:
                track.state.move_frame(motion)
        # (C) data association
        predicted = np.array([track.state.box for track in tracks]).reshape(-1, 7)
        similarity = SIMILARITY[p.similarity](predicted, boxes)
        matching = hungarian(1.0 - similarity, 1.0 - p.min_similarity)
        # (D) 3-D Kalman filter: state update, with orientation correction
        for row, column in matching.pairs:
            tracks[row].state.update(boxes[column])
            self.life.hit(tracks[row], scores[column], column)
        # (E) birth and death memory
        for column in matching.unmatched_columns:
            self.life.birth(BoxFilter(boxes[column], p.noise), scores[column], column)
        shown = self.life.report(self._is_shown, lambda track: track.state.box)
        self.life.bury(lambda track: track.time_since_update >= p.max_age)
        return shown

    def _is_shown(self, track: Track) -> bool:
        settled = track.hits >= self.parameters.min_hits
        early = self.life.frame_count <= self.parameters.min_hits
        return track.time_since_update < self.parameters.max_age and (settled or early)
