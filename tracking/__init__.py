"""Boxes to trajectories: Algorithm 1 and the baselines SORT, DEEP_SORT, AB3DMOT (no TensorFlow)."""

from tracking.appearance import geometric_appearance
from tracking.factory import TRACKERS, make_tracker
from tracking.interface import Tracker, Tracks
from tracking.true_displacement import TrueDisplacement, assign_label_ids

__all__ = [
    "TRACKERS",
    "Tracker",
    "Tracks",
    "TrueDisplacement",
    "assign_label_ids",
    "geometric_appearance",
    "make_tracker",
]
