"""Labelled frames from disk: points, vehicle boxes, ground, ignored regions."""

from typing import NamedTuple

import numpy as np

from common.errors import InputError
from kitti.ground import GroundModel, fit_ground, ground_mask
from kitti.objects import CLASSES
from kitti.sequence import KittiSequence

FEWEST = 2  # points of a frame: a single scan is split into two


class LabelledFrame(NamedTuple):
    """One frame with the labels that training needs."""

    points: np.ndarray  # (n, 3) float32 level frame, camera crop
    boxes: np.ndarray  # (M, 7) float64 level frame, vehicles only
    classes: np.ndarray  # (M,) int32 index into the detector's classes
    track_ids: np.ndarray  # (M,) int64
    ground: np.ndarray  # (n,) bool
    ignored: np.ndarray  # (n,) bool, in the image inside a DontCare region
    ground_model: GroundModel
    other_boxes: np.ndarray  # (K, 7) float64, labelled objects of other classes
    other_ids: np.ndarray  # (K,) int64

    def only(self, rows: np.ndarray) -> "LabelledFrame":
        """The frame with some of its points, by their rows (k,) or a mask (n,)."""
        return self._replace(
            points=self.points[rows], ground=self.ground[rows], ignored=self.ignored[rows]
        )


def frame_list(sequences: list[KittiSequence]) -> list[tuple[int, int]]:
    """(sequence index, frame) of every frame that has a scan."""
    return [(i, t) for i, s in enumerate(sequences) for t in s.frames if s.has_scan(t)]


def pair_list(sequences: list[KittiSequence], single_scans: bool = False) -> list[tuple[int, int]]:
    """(sequence index, t) of every adjacent pair (t-1, t) whose two scans are there.

    With `single_scans` also of every scan t that is in no such pair.
    """
    items = []
    for i, sequence in enumerate(sequences):
        pairs = sequence.pairs(scans=True)
        items += [(i, t) for _, t in pairs]
        if single_scans:
            paired = {t for pair in pairs for t in pair}
            items += [(i, t) for _, t in frame_list([sequence]) if t not in paired]
    return items


def read_frame(sequence: KittiSequence, t: int, classes: tuple[str, ...]) -> LabelledFrame:
    """Reads frame t of a sequence; the ground points and DontCare regions are found here.

    Raises:
        InputError: a file is broken, or fewer than `FEWEST` points lie in the camera's view.
    """
    points = np.ascontiguousarray(sequence.read_points_level(t)[:, :3], np.float32)
    if len(points) < FEWEST:
        found = f"expected at least {FEWEST} points in the camera's view, found {len(points)}"
        raise InputError(found, sequence.scan_path(t))
    objects = sequence.objects.at(t)
    vehicles = objects.of_classes(classes)
    others = objects.of_classes([name for name in CLASSES if name not in (*classes, "DontCare")])
    names = np.array([classes.index(name) for name in vehicles.type], np.int32)
    model = fit_ground(points)
    regions = objects.of_classes(("DontCare",)).bbox
    return LabelledFrame(
        points,
        np.asarray(vehicles.boxes, np.float64).reshape(-1, 7),
        names,
        np.asarray(vehicles.track_id, np.int64),
        ground_mask(points, model),
        _inside(points, sequence, regions),
        model,
        np.asarray(others.boxes, np.float64).reshape(-1, 7),
        np.asarray(others.track_id, np.int64),
    )


def _inside(points: np.ndarray, sequence: KittiSequence, regions: np.ndarray) -> np.ndarray:
    inside = np.zeros(len(points), bool)
    if len(regions) and len(points):
        uv, _ = sequence.calib.project_level(points)
        for x1, y1, x2, y2 in regions:
            u, v = uv[:, 0], uv[:, 1]
            inside |= (u >= x1) & (u <= x2) & (v >= y1) & (v <= y2)
    return inside
