"""Trackers by name: a new tracker is added to `TRACKERS`, see CONTRIBUTING.md."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from common.errors import InputError
from tracking.ab3dmot import Ab3dmot, Ab3dmotParameters
from tracking.association_to_trajectory import (
    AssociationByLabels,
    AssociationParameters,
    AssociationToTrajectory,
)
from tracking.deep_sort import DeepSort, DeepSortParameters
from tracking.interface import MultiObjectTracker
from tracking.sort import Sort, SortParameters

TRACKERS: dict[str, tuple[Callable[[Any], MultiObjectTracker], Any]] = {
    "pointtracknet": (AssociationToTrajectory, AssociationParameters(min_hits=3)),
    "pointtracknet_no_probation": (AssociationToTrajectory, AssociationParameters()),
    "pointtracknet_published": (
        AssociationToTrajectory,
        AssociationParameters(similarity="iou_3d", lost_frames=0, duplicate_iou=1.0),
    ),
    "gt_displacement": (AssociationByLabels, AssociationParameters()),
    "sort": (Sort, SortParameters()),
    "sort_image": (Sort, SortParameters(space="image")),
    "deep_sort": (DeepSort, DeepSortParameters()),
    "deep_sort_published": (DeepSort, DeepSortParameters(lost_frames=1)),
    "ab3dmot": (Ab3dmot, Ab3dmotParameters()),
}
"""Name -> class and its default parameters."""
PREDICTED_MOTION = ("pointtracknet", "pointtracknet_no_probation", "pointtracknet_published")
"""The trackers that need the networks' displacement."""
WITH_APPEARANCE = ("deep_sort", "deep_sort_published")
"""The trackers that use the networks' appearance vectors."""


def make_tracker(name: str, **parameters: Any) -> MultiObjectTracker:
    """A new tracker for one sequence; `parameters` are fields of its dataclass.

    Raises `InputError` for an unknown name or parameter, or a value the tracker cannot work with.
    """
    if name not in TRACKERS:
        raise InputError(f"expected a tracker among {', '.join(TRACKERS)}, found {name!r}")
    tracker, defaults = TRACKERS[name]
    known = [field.name for field in fields(defaults)]
    for key in parameters:
        if key not in known:
            raise InputError(f"{name} has the parameters {', '.join(known)}; found {key!r}")
    return tracker(replace(defaults, **parameters))
