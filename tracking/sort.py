"""SORT (Bewley et al., ICIP 2016), on 3-D boxes of the level frame or on their image boxes.

Constant-velocity Kalman filter, Hungarian assignment on the IoU with the predicted boxes, and a
short probation; no appearance, no motion of the sensor. PointTrackNet's paper does not specify the
space of SORT: `sort` uses boxes of the level frame, `sort_image` boxes in the image.
"""

from dataclasses import dataclass

import numpy as np

from common.errors import InputError
from kitti.iou import iou_2d, iou_3d
from tracking.frame_detections import FrameDetections
from tracking.interface import NO_CONTEXT, FrameContext, Tracks
from tracking.kalman_box import KalmanBox, Noise
from tracking.kalman_image import KalmanImage
from tracking.kalman_tracker import KalmanTracker
from tracking.life_cycle import Track

SPACES = {"level": (KalmanBox, iou_3d), "image": (KalmanImage, iou_2d)}


@dataclass(frozen=True)
class SortParameters:
    """SORT's own defaults (the values its authors published with the paper)."""

    min_iou: float = 0.3  # "IOU_min", section III.C
    max_age: int = 1  # "T_Lost = 1 in all experiments", section III.D
    min_hits: int = 3  # matches of the probation, section III.D; the authors' default is 3
    noise: Noise = Noise()
    space: str = "level"  # or "image": needs `FrameContext.image_boxes`

    def __post_init__(self):
        if self.space not in SPACES:
            raise InputError(f"space: expected one of {', '.join(SPACES)}, found {self.space!r}")


class Sort(KalmanTracker):
    """SORT for one sequence."""

    def __init__(self, parameters: SortParameters | None = None):
        super().__init__(parameters or SortParameters())

    def update(self, detections: FrameDetections, context: FrameContext = NO_CONTEXT) -> Tracks:
        """See `MultiObjectTracker.update`; image-space SORT skips boxes outside the image."""
        p = self.parameters
        new_filter, iou = SPACES[p.space]
        measured, rows = self._measured(detections.boxes, context)
        self.associate(
            detections, measured, rows, iou, p.min_iou, lambda box: new_filter(box, p.noise)
        )
        self.life.drop(lambda track: track.time_since_update > p.max_age)
        return self.life.report(self._is_shown, lambda track: detections.boxes[track.detection])

    def _measured(self, boxes: np.ndarray, context: FrameContext) -> tuple[np.ndarray, np.ndarray]:
        """Boxes in the space of the filter, and their rows in `boxes`."""
        if self.parameters.space == "level":
            return boxes, np.arange(len(boxes))
        image_boxes = context.image_boxes(boxes)
        if image_boxes is None:
            raise InputError("sort_image: expected a FrameContext with image_boxes()")
        image_boxes = np.asarray(image_boxes, np.float64)
        if image_boxes.shape != (len(boxes), 4):
            raise InputError(f"expected image_boxes ({len(boxes)}, 4), found {image_boxes.shape}")
        extent = image_boxes[:, 2:] - image_boxes[:, :2]
        rows = np.flatnonzero((np.isfinite(extent) & (extent > 0)).all(axis=1))
        return image_boxes[rows], rows

    def _is_shown(self, track: Track) -> bool:
        """True for a settled track matched in this frame; in the first frames for any match."""
        settled = track.hit_streak >= self.parameters.min_hits
        early = self.life.frame_count <= self.parameters.min_hits
        return track.detection >= 0 and (settled or early)
