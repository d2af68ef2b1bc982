"""Trackers by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

from common.errors import InputError
from tracking.ab3dmot import Ab3dmot, Ab3dmotParameters
from tracking.association_to_trajectory import AssociationParameters, AssociationToTrajectory
from tracking.deep_sort import DeepSort, DeepSortParameters
from tracking.interface import Tracker
from tracking.sort import Sort, SortParameters

TRACKERS: dict[str, tuple[Callable[[Any], Tracker], type]] = {
    "pointtracknet": (AssociationToTrajectory, AssociationParameters),
    "gt_displacement": (AssociationToTrajectory, AssociationParameters),
    "sort": (Sort, SortParameters),
    "deep_sort": (DeepSort, DeepSortParameters),
    "ab3dmot": (Ab3dmot, Ab3dmotParameters),
}


def make_tracker(name: str, **parameters: Any) -> Tracker:
    """A new tracker for one sequence; `parameters` are fields of its dataclass.

    Raises `InputError` for an unknown name or parameter, or a value the tracker cannot work with.
    """
    if name not in TRACKERS:
        raise InputError(f"expected a tracker among {', '.join(TRACKERS)}, found {name!r}")
    tracker, parameter_type = TRACKERS[name]
    known = [field.name for field in fields(parameter_type)]
    for key in parameters:
        if key not in known:
            raise InputError(f"{name} has the parameters {', '.join(known)}; found {key!r}")
    return tracker(parameter_type(**parameters))
