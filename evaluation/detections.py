"""Detection providers: labels, detection files, the networks; all give `FrameDetections`.

TensorFlow is imported only where the networks are loaded. Letters: M boxes of a frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from common.errors import InputError
from common.notes import note
from evaluation.scene import Scene
from kitti.objects import VEHICLES, Objects
from models.weight_files import network_files
from tracking.frame_detections import FOREGROUND, FrameDetections

if TYPE_CHECKING:
    from models.inference import FrameState, StreamingNetwork


class DetectionProvider(Protocol):
    """Detections of every frame of a scene."""

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """Yields the frames of `scene.frames` in order, empty ones included."""


class LabelBoxes:
    """The labelled boxes of some classes, with score 1 and label ids."""

    def __init__(self, classes: Sequence[str]):
        self.classes = classes

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        labels = scene.objects.of_classes(self.classes)
        for found in by_frame(labels, scene.frames):
            yield replace(found, label_ids=labels.at(found.t).track_id)


class DetectionFiles:
    """Detections of some classes from files; all are read on construction and validated.

    Args:
        folder: see `kitti.detections.read_detection_folder`.
        scenes: the sequences to be read.
        classes: kept classes.

    Raises:
        InputError: a file is missing or malformed.
    """

    def __init__(self, folder: str | Path, scenes: Sequence[Scene], classes: Sequence[str]):
        check_folder(folder)
        alone = len(scenes) == 1
        read = {s.name: s.sequence.read_detections(folder, alone) for s in scenes}
        note_other_classes(folder, Objects.concatenate(read.values()), classes)
        self.detections = {name: rows.of_classes(classes) for name, rows in read.items()}

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        yield from by_frame(scene.shifted(self.detections[scene.name]), scene.frames)


class NetworkStream:
    """Scans of one sequence, in order, to detections; each scan passes the detector once."""

    def __init__(self, network: "StreamingNetwork"):
        self.network = network
        self.class_names = np.array(network.detector.config.box.classes)
        self.state: FrameState | None = None

    def detect(self, points: np.ndarray, t: int) -> FrameDetections:
        """The detector's boxes in frame t and the predicted motion from the scan before it.

        points: (n, >=3) level frame, metres, camera crop; n may be 0 for a missing scan.
        """
        return self.follow(self.network.detect(points, t), t)

    def follow(self, state: "FrameState", t: int) -> FrameDetections:
        """As `detect`, of a scan that has passed the detector."""
        previous, self.state = self.state, state
        found = state.detections
        motion = {} if previous is None else self._motion(previous, state)
        types = self.class_names[found.classes]
        mask = state.points[state.foreground >= FOREGROUND]
        return FrameDetections(t, found.boxes, found.scores, types, **motion, mask=mask)

    def _motion(self, previous: "FrameState", current: "FrameState") -> dict[str, np.ndarray]:
        """Points of the earlier frame and their motion; none where the later one has no points.

        Without points in frame t the displacement is unknown, which is not the same as 0.
        """
        rows = slice(len(previous.points) if len(current.points) else 0)
        return {
            "points": previous.points[rows],
            "foreground": previous.foreground[rows],
            "displacement": self.network.displacement(previous, current)[rows],
        }


class NetworkDetections:
    """The detector's boxes, or another provider's with the networks' motion and appearance.

    Args:
        network: detector and tracker.
        boxes: provider of the boxes in place of the detector (labels, files), if given.
    """

    def __init__(self, network: "StreamingNetwork", boxes: DetectionProvider | None = None):
        self.network, self.boxes = network, boxes

    @classmethod
    def load(
        cls, weights: str | Path, boxes: DetectionProvider | None = None
    ) -> "NetworkDetections":
        """Loads the networks of a folder of weights; boxes of every score are found.

        Raises:
            InputError: weights are missing, broken or do not belong together.
        """
        network_files(weights)  # before the import of TensorFlow
        from models.inference import StreamingNetwork
        from models.weights import load_networks

        return cls(StreamingNetwork(*load_networks(weights), min_score=0.0), boxes)

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        given = None if self.boxes is None else self.boxes.frames(scene)
        stream = NetworkStream(self.network)
        for t in scene.frames:
            points = scene.points(t)
            found = stream.detect(np.zeros((0, 3)) if points is None else points, t)
            if given is not None:
                found = with_motion(next(given), found)
            appearance = self.network.appearance(stream.state, found.boxes)
            yield replace(found, appearance=appearance)


class BoxesAtLeast:
    """The boxes of another provider that have at least a score."""

    def __init__(self, provider: DetectionProvider, min_score: float):
        self.provider, self.min_score = provider, min_score
        self.largest = -np.inf  # score so far

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        for found in self.provider.frames(scene):
            self.largest = max(self.largest, found.scores.max(initial=-np.inf))
            yield found.only(found.scores >= self.min_score)


class BoxesOfClasses:
    """The boxes of another provider that are of some classes."""

    def __init__(self, provider: DetectionProvider, classes: Sequence[str]):
        self.provider, self.classes = provider, classes
        self.found: set[str] = set()  # classes of all boxes so far

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        for found in self.provider.frames(scene):
            self.found |= set(found.types.tolist())
            yield found.only(np.isin(found.types, self.classes))


class LabelBoxesWithPredictedMotion:
    """The labelled boxes of some classes with the motion that another provider predicts."""

    def __init__(self, predicted: DetectionProvider, classes: Sequence[str] = VEHICLES):
        self.predicted, self.labelled = predicted, LabelBoxes(classes)

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        pairs = zip(self.labelled.frames(scene), self.predicted.frames(scene), strict=True)
        for labelled, predicted in pairs:
            yield with_motion(labelled, predicted)


def with_motion(boxes: FrameDetections, motion: FrameDetections) -> FrameDetections:
    """The first's boxes with the second's points, displacement, foreground probability and mask.

    Labelled boxes are complete: without a mask, no vehicle is missed in them.
    """
    return replace(
        boxes,
        mask=motion.mask if boxes.label_ids is None else None,
        points=motion.points,
        displacement=motion.displacement,
        foreground=motion.foreground,
    )


def by_frame(objects: Objects, frames: range) -> Iterator[FrameDetections]:
    """Rows with boxes, frame by frame; a missing score counts as 1."""
    scores = np.where(np.isnan(objects.score), 1.0, objects.score)
    edges = np.searchsorted(objects.frame, np.arange(frames.start, frames.stop + 1))
    for t, first, last in zip(frames, edges[:-1], edges[1:], strict=True):
        rows = slice(first, last)
        yield FrameDetections(t, objects.boxes[rows], scores[rows], objects.type[rows])


def note_other_classes(folder: str | Path, rows: Objects, classes: Sequence[str]) -> None:
    """Notes files without any box, or with boxes of other classes than those evaluated alone."""
    if len(rows):
        note_if_others(folder, set(rows.type.tolist()), classes)
    else:
        note(f"{folder}: there is no box in it")


def note_if_others(source: str | Path, found: set[str], classes: Sequence[str]) -> None:
    """Notes boxes from `source` of which none is of the classes."""
    if found and not found & set(classes):
        all_are = ", ".join(sorted(found))
        note(f"{source}: no box is of --classes {','.join(classes)}, all are {all_are}")


def note_low_scores(largest: float, least: float) -> None:
    """Notes a threshold above the greatest score, `largest`: every box or track is left out."""
    if -np.inf < largest < least:
        note(f"--score_threshold {least:g}: all scores are lower, the greatest is {largest:g}")


def check_folder(folder: str | Path) -> None:
    """Raises InputError unless `folder` is a directory."""
    if not Path(folder).is_dir():
        raise InputError("expected a directory with files 00XX.txt", folder)
