"""Outputs of the frozen detector for evaluated frames, stored on disk for several trackers."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from common.files import write_arrays
from common.progress import Progress
from evaluation.detections import NetworkStream
from evaluation.scene import Scene
from models.boxes.box_decoding import Detections
from models.inference import FrameState, StreamingNetwork
from tracking import FrameDetections


def frame_path(folder: Path, scene: Scene, t: int) -> Path:
    """The file of a frame."""
    return folder / scene.name / f"{t:06d}.npz"


def store_frames(
    network: StreamingNetwork, scenes: Sequence[Scene], folder: Path, title: str
) -> None:
    """Writes boxes, kept points and features (float16) of every frame that has no file yet.

    `network`: the configuration of its tracker selects points and features; it is not run.
    """
    with Progress(sum(len(scene.frames) for scene in scenes), title, "frames") as bar:
        for scene in scenes:
            for t in scene.frames:
                path = frame_path(folder, scene, t)
                if not path.is_file():
                    points = scene.points(t)
                    state = network.detect(np.zeros((0, 3)) if points is None else points, t)
                    found = state.detections
                    write_arrays(
                        path,
                        points=state.points,
                        foreground=state.foreground,
                        features=state.features.astype(np.float16),
                        boxes=found.boxes,
                        scores=found.scores,
                        classes=found.classes,
                    )
                bar.update()


class StoredDetections:
    """Stored frames with the displacement that a tracker predicts, as a `DetectionProvider`.

    Args:
        network: its tracker was trained on the detector that made the frames; runs once a scene.
        folder: of `store_frames`, called with the tracker's kept points and features.
    """

    def __init__(self, network: StreamingNetwork, folder: Path):
        self.network, self.folder = network, folder
        self._found: dict[str, list[FrameDetections]] = {}

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        if scene.name not in self._found:
            stream = NetworkStream(self.network)
            self._found[scene.name] = [
                stream.follow(self._state(scene, t), t) for t in scene.frames
            ]
        yield from self._found[scene.name]

    def _state(self, scene: Scene, t: int) -> FrameState:
        with np.load(frame_path(self.folder, scene, t)) as file:
            found = Detections(file["boxes"], file["scores"], file["classes"])
            features = file["features"].astype(np.float32)
            return self.network.restored(file["points"], file["foreground"], features, found)
