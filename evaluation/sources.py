"""Where the boxes that are tracked come from: the labels, or detection files.

Letters: M boxes of a frame, n points, C channels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from common.errors import InputError
from evaluation.scene import Scene
from kitti.labels import Objects

Detected = tuple[int, np.ndarray, np.ndarray, dict[str, Any]]

MOTION = ("points", "foreground", "displacement")  # of `BoxSource`: what the tracker graph says


class BoxSource(Protocol):
    """Gives the boxes of every frame of a scene, frame 0 first, empty frames included."""

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """Yields (t, boxes (M, 7) level frame, scores (M,), extras).

        `extras` holds what comes along with the boxes:
            types: (M,) class names (always).
            points: (n, 3) points of frame t-1, level frame; displacement: (n, 3) their predicted
                movement to frame t, metres; foreground: (n,) their foreground probability (needed
                by the tracker `pointtracknet`).
            appearance: (M, C) a vector per box (used by `deep_sort` if present).
            label_ids: (M,) ids where the boxes are labels (spares `gt_displacement` finding them).
        """


class GroundTruthBoxes:
    """The labelled boxes of some classes, where the scene has them; score 1."""

    def __init__(self, classes: Sequence[str]):
        self.classes = classes

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        labels = scene.objects.of_classes(self.classes)
        for t, boxes, scores, extras in by_frame(labels, scene.num_frames):
            yield t, boxes, scores, {**extras, "label_ids": labels.at(t).track_id}


class DetectionFiles:
    """Detections of some classes, see `kitti.detections.read_detection_folder`.

    All files are read at once, so that a bad one is found before any work is done.

    Raises:
        InputError: a file is missing or is not what it should be.
    """

    def __init__(self, folder: str | Path, scenes: Sequence[Scene], classes: Sequence[str]):
        check_folder(folder)
        self.detections = {
            scene.name: scene.sequence.read_detections(folder).of_classes(classes)
            for scene in scenes
        }

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        yield from by_frame(scene.displaced(self.detections[scene.name]), scene.num_frames)


def motion_of(extras: dict[str, Any]) -> dict[str, Any]:
    """What the tracker graph says of a frame, as `Tracker.update` takes it; {} if nothing."""
    return {key: extras[key] for key in MOTION if key in extras}


def by_frame(objects: Objects, num_frames: int) -> Iterator[Detected]:
    """Rows with boxes, frame by frame; a missing score counts as 1."""
    scores = np.where(np.isnan(objects.score), 1.0, objects.score)
    edges = np.searchsorted(objects.frame, np.arange(num_frames + 1))
    for t in range(num_frames):
        rows = slice(edges[t], edges[t + 1])
        yield t, objects.boxes[rows], scores[rows], {"types": objects.type[rows]}


def check_folder(folder: str | Path) -> None:
    """Raises InputError unless `folder` is a directory."""
    if not Path(folder).is_dir():
        raise InputError("expected a directory with files 00XX.txt", folder)
