"""The frozen detector's outputs of evaluated frames, on disk, for several trackers on top of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import tensorflow as tf

from common.files import atomic_path
from common.progress import Progress
from evaluation.scene import Scene
from models.inference import StreamingNetwork
from models.tracker import TrackerInputs, TrackingNetwork
from tracking import FrameDetections

BOXES = ("boxes", "scores", "types")


def frame_path(folder: Path, scene: Scene, t: int) -> Path:
    """The file of a frame."""
    return folder / scene.name / f"{t:06d}.npz"


def store_frames(
    network: StreamingNetwork, scenes: Sequence[Scene], folder: Path, title: str
) -> None:
    """Writes boxes, kept points and features (float16) of every frame that has no file yet.

    `network`: its tracker says which points and features are kept, and is not run.
    """
    names = np.array(network.detector.config.box.classes)
    with Progress(sum(len(scene.frames) for scene in scenes), title, "frames") as bar:
        for scene in scenes:
            for t in scene.frames:
                path = frame_path(folder, scene, t)
                if not path.is_file():
                    points = scene.points(t)
                    state = network.detect(np.zeros((0, 3)) if points is None else points, t)
                    found = state.detections
                    with atomic_path(path) as temporary, temporary.open("wb") as file:
                        np.savez(
                            file,
                            points=state.points,
                            foreground=state.foreground,
                            features=state.features.astype(np.float16),
                            boxes=found.boxes,
                            scores=found.scores,
                            types=names[found.classes].astype("<U16"),
                        )
                bar.update()


class StoredDetections:
    """Stored frames with the displacement that a tracker predicts, as a `DetectionProvider`.

    Args:
        tracker: trained on the detector that made the frames; runs once for each scene.
        folder: of `store_frames`, called with the tracker's kept points and features.
    """

    def __init__(self, tracker: TrackingNetwork, folder: Path):
        self.folder = folder
        self._encode = tf.function(tracker.encode, jit_compile=False)
        self._displacement = tf.function(tracker.displacement, jit_compile=False)
        self._found: dict[str, list[FrameDetections]] = {}

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        if scene.name not in self._found:
            self._found[scene.name] = list(self._predict(scene))
        yield from self._found[scene.name]

    def _predict(self, scene: Scene) -> Iterator[FrameDetections]:
        before, encoded_before, motion = None, None, {}
        for t in scene.frames:
            with np.load(frame_path(self.folder, scene, t)) as file:
                now = dict(file)
            encoded = self._encode(_inputs(now)) if len(now["points"]) else None
            if before is not None:
                motion = {name: before[name] for name in ("points", "foreground")}
                motion["displacement"] = np.zeros_like(before["points"])
                if encoded_before is not None and encoded is not None:
                    found = self._displacement(encoded_before, encoded)
                    motion["displacement"] = found.numpy()[0]
            yield FrameDetections(t, **{name: now[name] for name in BOXES}, **motion)
            before, encoded_before = now, encoded


def _inputs(frame: dict[str, np.ndarray]) -> TrackerInputs:
    rows = np.zeros((1, len(frame["points"])), np.int32)  # where they were among the N points
    features = frame["features"].astype(np.float32)
    return TrackerInputs(*map(tf.constant, (rows, frame["points"][None], features[None])))
