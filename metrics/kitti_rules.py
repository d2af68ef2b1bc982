"""Evaluation rules of the KITTI benchmark: evaluated classes and ignored boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.errors import InputError
from kitti.iou import EPS, covered
from kitti.objects import Objects
from metrics.comparison import rows_by_frame


@dataclass(frozen=True)
class KittiRules:
    """The benchmark's constants for one class (devkit, evaluate_tracking.py)."""

    evaluated: str = "Car"
    neighbours: tuple[str, ...] = ("Van",)
    max_truncation: int = 0
    max_occlusion: int = 2
    min_height: float = 25.0  # pixels; an unmatched result of this height or less is ignored
    max_dontcare: float = 0.5  # share of a result's 2-D area in one DontCare box
    mostly_tracked: float = 0.8  # more than this share of a trajectory
    mostly_lost: float = 0.2  # less than this share


RULES = KittiRules()
RULES_OF = {
    "Car": RULES,
    "Pedestrian": KittiRules("Pedestrian", ("Person", "Person_sitting")),
    "Cyclist": KittiRules("Cyclist", ()),
}
"""By evaluated class; the neighbours are similar classes, which are ignored."""
CLASSES_OF = {
    "kitti2d": ("Car", "Pedestrian"),
    "hota": ("Car", "Pedestrian"),
    "kitti3d": ("Car", "Pedestrian", "Cyclist"),
}
"""Evaluated classes by protocol: TrackEval's for KITTI, and AB3DMOT's."""


def rules_for(protocol: str, classes: Sequence[str]) -> KittiRules:
    """The rules of a protocol for `classes`: one evaluated class, with neighbours of it or not.

    Raises:
        InputError: the protocol is not defined for these classes.
    """
    known = CLASSES_OF[protocol]
    evaluated = [name for name in known if name in classes]
    if len(evaluated) == 1:
        rules = RULES_OF[evaluated[0]]
        if set(classes) <= {rules.evaluated, *rules.neighbours}:
            return rules
    raise InputError(
        f"--classes: {protocol} evaluates one class of {', '.join(known)} at a time (with its "
        f"neighbours such as Van), found {','.join(classes)}"
    )


def evaluated_classes(objects: Objects, rules: KittiRules = RULES) -> Objects:
    """Rows of the evaluated class and its neighbours that carry an id."""
    rows = objects.of_classes((rules.evaluated, *rules.neighbours))
    return rows[rows.track_id >= 0]


def ignored_truth(truth: Objects, rules: KittiRules = RULES) -> np.ndarray:
    """(R,) bool: truncated, heavily occluded, or of a neighbouring class."""
    return (
        np.isin(truth.type, rules.neighbours)
        | (truth.occlusion.astype(int) > rules.max_occlusion)
        | (truth.truncation.astype(int) > rules.max_truncation)
    )


def ignorable_results(
    results: Objects, dontcare: Objects, num_frames: int, rules: KittiRules = RULES
) -> np.ndarray:
    """(S,) bool: results that are not false alarms even if unmatched.

    Args:
        results: S rows with 2-D boxes in pixels.
        dontcare: the sequence's DontCare rows.
        num_frames: frames of the sequence.
    """
    height = results.bbox[:, 3] - results.bbox[:, 1]
    ignorable = (height <= rules.min_height) | np.isin(results.type, rules.neighbours)
    return ignorable | in_dontcare(results, dontcare, num_frames, rules)


def in_dontcare(
    results: Objects, dontcare: Objects, num_frames: int, rules: KittiRules = RULES
) -> np.ndarray:
    """(S,) bool: most of the 2-D box lies in one DontCare region; as `ignorable_results`."""
    inside = np.zeros(len(results), bool)
    frames = zip(
        rows_by_frame(results.frame, num_frames),
        rows_by_frame(dontcare.frame, num_frames),
        strict=True,
    )
    for rows, regions in frames:
        inside[rows] = boxes_in_dontcare(results.bbox[rows], dontcare.bbox[regions], rules)
    return inside


def boxes_in_dontcare(
    boxes: np.ndarray, regions: np.ndarray, rules: KittiRules = RULES
) -> np.ndarray:
    """(K,) bool: boxes (K, 4) of which most lies in one of the regions (D, 4) of their frame."""
    return (covered(boxes, regions) > rules.max_dontcare + EPS).any(axis=1)
