"""The interface of all trackers, and the step of every tracking loop.

Letters: M detected boxes of this frame, T tracks, n points.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tracking.frame_detections import FrameDetections
from tracking.label_motion import LabelMotion


@dataclass(frozen=True)
class Tracks:
    """The reported tracks of one frame, ordered by id.

    Attributes:
        boxes: (T, 7) float64, level frame: x, y, z, l, w, h in metres, yaw in radians.
        ids: (T,) int64, from 0 within one tracker, never reused.
        scores: (T,) float64, the score of the detection that was matched last.
        types: (T,) class names, likewise.
        detections: (T,) int64, row of this frame's detections that was matched, -1 for a lost
            object whose predicted box is reported.
    """

    boxes: np.ndarray
    ids: np.ndarray
    scores: np.ndarray
    types: np.ndarray
    detections: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)


class FrameContext:
    """Data about frame t other than its detections; this base class has none.

    Subclasses may compute them on access: each tracker reads those of its method alone.

    Attributes:
        ego_motion: (4, 4), takes level-frame coordinates of t-1 to those of t (AB3DMOT).
        label_motion: motion of the labelled objects from t-1 to t (upper bound of Algorithm 1).
    """

    ego_motion: np.ndarray | None = None
    label_motion: LabelMotion | None = None

    def image_boxes(self, boxes: np.ndarray) -> np.ndarray | None:
        """(M, 7) level boxes -> (M, 4) pixels, NaN outside the image (SORT in image space)."""


NO_CONTEXT = FrameContext()


class MultiObjectTracker(Protocol):
    """A tracker of one sequence; for each frame in turn `predict()`, then `update(...)`."""

    def predict(self) -> None:
        """Predicts the tracks in frame t from those in frame t-1."""

    def update(self, detections: FrameDetections, context: FrameContext = NO_CONTEXT) -> Tracks:
        """Associates the detections of frame t with the tracks.

        Without data that are not there (`None`) a tracker does without: Algorithm 1 then moves a
        box by its last displacement, at first by none; AB3DMOT takes the sensor as standing.

        Raises:
            InputError: `sort_image` without the image boxes of the context.
        """


def track_frame(
    tracker: MultiObjectTracker, detections: FrameDetections, context: FrameContext = NO_CONTEXT
) -> Tracks:
    """Tracks the next frame of a sequence."""
    tracker.predict()
    return tracker.update(detections, context)
