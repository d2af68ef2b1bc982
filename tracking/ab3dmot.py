"""AB3DMOT (Weng et al., IROS 2020): 3-D Kalman filter, Hungarian assignment, birth and death.

Section and module names are the paper's. The defaults are those of the published results for
PointRCNN cars: GIoU instead of IoU, and compensation of the sensor's motion.
"""

from dataclasses import dataclass

import numpy as np

from tracking.frame_detections import FrameDetections, checked_rows
from tracking.interface import NO_CONTEXT, FrameContext, Tracks
from tracking.kalman_box import KalmanBox, Noise
from tracking.kalman_tracker import KalmanTracker
from tracking.life_cycle import Track
from tracking.similarity import SIMILARITY, check_similarity


@dataclass(frozen=True)
class Ab3dmotParameters:
    """AB3DMOT's values for cars."""

    similarity: str = "giou_3d"  # or iou_3d; the authors' setting for PointRCNN cars
    min_similarity: float = -0.2  # the authors' GIoU setting; the paper's IoU_min is 0.01
    max_age: int = 2  # "Age_max = 2", section IV
    min_hits: int = 3  # "Bir_min = 3", section IV
    noise: Noise = Noise()  # section III.B and the authors' setting

    def __post_init__(self):
        check_similarity(self.similarity)


class Ab3dmot(KalmanTracker):
    """AB3DMOT for one sequence."""

    def __init__(self, parameters: Ab3dmotParameters | None = None):
        super().__init__(parameters or Ab3dmotParameters())

    def update(self, detections: FrameDetections, context: FrameContext = NO_CONTEXT) -> Tracks:
        """See `MultiObjectTracker.update`; (B) is `predict`."""
        p = self.parameters
        if context.ego_motion is not None:
            motion = checked_rows("ego_motion", context.ego_motion, 4, 4)
            for track in self.life.tracks:
                track.state.move_frame(motion)
        # (C) data association, (D) state update with orientation correction, (E) birth
        self.associate(
            detections,
            detections.boxes,
            np.arange(len(detections)),
            SIMILARITY[p.similarity],
            p.min_similarity,
            lambda box: KalmanBox(box, p.noise),
        )
        shown = self.life.report(self._is_shown, lambda track: track.state.box)
        self.life.drop(lambda track: track.time_since_update >= p.max_age)  # (E) death
        return shown

    def _is_shown(self, track: Track) -> bool:
        settled = track.hits >= self.parameters.min_hits
        early = self.life.frame_count <= self.parameters.min_hits
        return track.time_since_update < self.parameters.max_age and (settled or early)
