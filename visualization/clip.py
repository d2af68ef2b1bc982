"""Input of the pictures: consecutive scans with tracks and optional labels."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kitti.objects import VEHICLES, Objects


@dataclass(frozen=True)
class Clip:
    """A sequence with its tracks.

    Attributes:
        name: of the sequence.
        frames: numbers of the frames that are shown, in the rows and in `points`.
        points: scan of a frame, (n, >=3) level frame, or None where it is missing.
        results: the tracks.
        truth: labelled vehicles; no rows without labels.
        poses: (F, 4, 4) level frame of frame t -> of frame 0, F at least the end of `frames`; or
            None where unknown.
    """

    name: str
    frames: range
    points: Callable[[int], np.ndarray | None]
    results: Objects
    truth: Objects
    poses: np.ndarray | None = None

    @classmethod
    def of_scene(cls, scene, results: Objects) -> "Clip":
        """From an `evaluation.scene.Scene` and the rows of its result file."""
        truth = scene.objects.of_classes(VEHICLES)
        poses = scene.sequence.poses
        return cls(scene.name, scene.frames, scene.points, results, truth, poses)

    def scan(self, t: int) -> np.ndarray:
        """(n, 3) points of frame t; (0, 3) where the scan is missing."""
        points = self.points(t)
        return np.zeros((0, 3), np.float32) if points is None else points[:, :3]

    def transform(self, source: int, target: int) -> np.ndarray:
        """(4, 4) from the level frame of `source` to that of `target`; identity if unknown."""
        if self.poses is None:
            return np.eye(4)
        return np.linalg.solve(self.poses[target], self.poses[source])

    def trails(self, objects: Objects, t: int, length: int) -> dict[int, np.ndarray]:
        """Positions of the objects of frame t in the last `length` frames, in the frame of t.

        Returns:
            track id -> (k, 3) box centres in the level frame of t, oldest first.
        """
        recent = objects[(objects.frame <= t) & (objects.frame > t - length)]
        centres = recent.boxes[:, :3].copy()
        for frame in np.unique(recent.frame):
            rows, matrix = recent.frame == frame, self.transform(int(frame), t)
            centres[rows] = centres[rows] @ matrix[:3, :3].T + matrix[:3, 3]
        ids = objects.at(t).track_id
        return {int(i): centres[recent.track_id == i] for i in ids}

    def busiest_frame(self) -> int:
        """The frame of the second half with most labelled (else tracked) objects."""
        objects = self.truth if len(self.truth) else self.results
        later = self.frames[len(self.frames) // 2 :]
        count = np.bincount(objects.frame, minlength=later.stop)
        return later.start + int(np.argmax(count[later.start : later.stop]))
