"""Boxes to trajectories: Algorithm 1 and the baselines SORT, DEEP_SORT, AB3DMOT (no TensorFlow)."""

from tracking.factory import PREDICTED_MOTION, TRACKERS, WITH_APPEARANCE, make_tracker
from tracking.frame_detections import FrameDetections
from tracking.interface import FrameContext, MultiObjectTracker, Tracks, track_frame
from tracking.label_motion import LabelMotion, assign_label_ids

__all__ = [
    "PREDICTED_MOTION",
    "TRACKERS",
    "WITH_APPEARANCE",
    "FrameContext",
    "FrameDetections",
    "LabelMotion",
    "MultiObjectTracker",
    "Tracks",
    "assign_label_ids",
    "make_tracker",
    "track_frame",
]
