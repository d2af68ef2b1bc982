"""A sequence under evaluation: labels, detections and points, as on disk or shifted."""

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path

import numpy as np

from kitti.boxes import count_points_in_boxes
from kitti.check_points import check_points
from kitti.object_shift import (
    ObjectShift,
    shift_detections,
    shift_objects,
    shift_points,
)
from kitti.objects import Objects
from kitti.sequence import KittiSequence, open_sequences


class Scene:
    """One sequence, under an object shift (section IV.D of the paper) or as it is.

    Args:
        sequence: as it is on disk.
        shift: the shift; None for none.
    """

    def __init__(self, sequence: KittiSequence, shift: ObjectShift | None = None):
        self.sequence, self.shift = sequence, shift
        self.name = sequence.name
        self.frames, self.num_frames = sequence.frames, sequence.num_frames

    def check(self, poses: bool, scans: bool) -> None:
        """Reads labels, calibration and poses, and looks at a few scans, before any other work."""
        _ = self.objects, self.sequence.image_size, self.ego_motions if poses else None
        if scans:
            self.sequence.check_scans()
            check_points(self.sequence)

    @cached_property
    def _offsets(self) -> np.ndarray:
        """(R, 2) metres along x and y of the level frame, one per label row."""
        return self.shift.offsets(self.sequence.objects, self.sequence.seq)

    @cached_property
    def objects(self) -> Objects:
        """The labels of all classes, shifted as in this scene."""
        if self.shift is None:
            return self.sequence.objects
        return shift_objects(self.sequence.objects, self._offsets)

    def shifted(self, detections: Objects) -> Objects:
        """Detections of the sequence on disk, each shifted with the object it overlaps most."""
        if self.shift is None:
            return detections
        return shift_detections(detections, self.sequence.objects, self._offsets)

    def points(self, t: int) -> np.ndarray | None:
        """(n, 4) float32 scan of frame t in the level frame, camera crop; None without a scan."""
        if not self.sequence.has_scan(t):
            return None
        points = self.sequence.read_points_level(t)
        if self.shift is None:
            return points
        rows = self.sequence.objects.frame == t
        boxes = self.sequence.objects.boxes[rows]
        return shift_points(points, boxes, self._offsets[rows])

    def points_in(self, t: int, boxes: np.ndarray) -> np.ndarray:
        """(M,) int: points of frame t in each box (M, 7), one in several in the first alone."""
        points = self.points(t)
        if points is None:
            return np.zeros(len(boxes), int)
        return count_points_in_boxes(points, boxes)

    @cached_property
    def ego_motions(self) -> np.ndarray | None:
        """(F, 4, 4) level frame of t-1 -> level frame of t (identity at t = 0); None unknown."""
        poses = self.sequence.poses
        if poses is None:
            return None
        previous = np.concatenate([poses[:1], poses[:-1]])
        return np.linalg.solve(poses, previous)


def open_scenes(
    data_root: Path,
    seqs: Iterable[int],
    subset: str = "training",
    shift: ObjectShift | None = None,
    image_size: tuple[int, int] | None = None,
) -> list[Scene]:
    """The sequences as scenes; raises InputError for a missing one."""
    sequences = open_sequences(data_root, seqs, subset, image_size)
    return [Scene(sequence, shift) for sequence in sequences]
