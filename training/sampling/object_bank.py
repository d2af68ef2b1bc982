"""Labelled objects cut from training scans for pasting, as in SECOND (Yan et al., Sensors 2018)."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from kitti.boxes import box_corners
from kitti.targets import foreground_labels
from training.sampling.frames import LabelledFrame

MIN_POINTS = 20
"""Points, ground left out, that an object needs to be cut."""


class CutObject(NamedTuple):
    """An object at its place in the scan."""

    points: np.ndarray  # (k, 3) float32 level frame, those on the ground left out
    box: np.ndarray  # (7,) float64 level frame
    class_index: int


class ObjectBank:
    """Objects by data root and class. A draw chooses among the roots, then among the classes of the
    root, each with the same probability: real scans among many simulated, vans among many cars.

    Args:
        objects: one dictionary {class index: objects} for each data root.
    """

    def __init__(self, objects: Sequence[dict[int, list[CutObject]]]):
        self.objects = [of_root for of_root in objects if of_root]

    @classmethod
    def of_frames(cls, frames: Iterable[tuple[str, LabelledFrame]]) -> "ObjectBank":
        """Cuts objects from frames, each given with the name of its data root."""
        found: dict[str, dict[int, list[CutObject]]] = {}
        for root, frame in frames:
            for cut in cut_objects(frame):
                found.setdefault(root, {}).setdefault(cut.class_index, []).append(cut)
        return cls(list(found.values()))

    def __bool__(self) -> bool:
        return bool(self.objects)

    def draw(self, rng: np.random.Generator) -> CutObject:
        """A random object; the bank must not be empty."""
        of_root = self.objects[rng.integers(len(self.objects))]
        of_class = of_root[sorted(of_root)[rng.integers(len(of_root))]]
        return of_class[rng.integers(len(of_class))]


def cut_objects(frame: LabelledFrame) -> list[CutObject]:
    """Objects with at least `MIN_POINTS` points whose box is not cut by the edge of the view."""
    if not len(frame.points):
        return []
    labels = foreground_labels(frame.points, frame.boxes, frame.ground)
    left, right = view(frame.points)
    corners = box_corners(frame.boxes)
    azimuth = np.arctan2(corners[..., 1], corners[..., 0])
    whole = ((azimuth > left) & (azimuth < right)).all(axis=1)
    enough = np.bincount(labels + 1, minlength=len(frame.boxes) + 1)[1:] >= MIN_POINTS
    return [
        CutObject(frame.points[labels == m], frame.boxes[m], int(frame.classes[m]))
        for m in np.flatnonzero(whole & enough)
    ]


def view(points: np.ndarray) -> tuple[float, float]:
    """Least and largest azimuth in radians of the points (n, 3) of a camera's view."""
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    return float(azimuth.min()), float(azimuth.max())
