"""Outputs of the frozen detector for evaluated frames, stored on disk for several trackers."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from common.files import write_arrays
from common.progress import Progress
from evaluation.detections import NetworkStream
from evaluation.scene import Scene
from models.boxes.box_decoding import Detections
from models.config import FUSED_FEATURES
from models.inference import FrameState, StreamingNetwork, detector_pass
from models.tracker import all_fused_features
from tracking import FrameDetections


def frame_path(folder: Path, fused_features: str, scene: Scene, t: int) -> Path:
    """The file of a frame for a row of Table IV."""
    return folder / fused_features / scene.name / f"{t:06d}.npz"


def store_frames(
    network: StreamingNetwork, scenes: Sequence[Scene], folder: Path, title: str
) -> None:
    """Writes boxes, kept points and features (float16) of every frame that has no file yet.

    One pass of the detector serves all rows of Table IV, each with a file of its own.
    `network`: the configuration of its tracker gives the number of points; it is not run.
    """
    pass_detector = StoredPass(network)
    with Progress(sum(len(scene.frames) for scene in scenes), title, "frames") as bar:
        for scene in scenes:
            for t in scene.frames:
                if not frame_path(folder, FUSED_FEATURES[-1], scene, t).is_file():
                    for name, arrays in pass_detector(scene.points(t), t).items():
                        write_arrays(frame_path(folder, name, scene, t), **arrays)
                bar.update()


Arrays = dict[str, np.ndarray]


class StoredPass:
    """A pass of the detector for all rows of Table IV; `network` as in `store_frames`."""

    def __init__(self, network: StreamingNetwork):
        self.network, self.rows = network, all_fused_features(network.tracker.config)
        self._run = detector_pass(network.detector, network.decoding.min_probability, self._choose)

    def _choose(self, inputs, outputs):
        return {name: choose(inputs, outputs) for name, choose in self.rows.items()}

    def __call__(self, points: np.ndarray | None, t: int) -> dict[str, Arrays]:
        """The arrays of each row, from the points of frame t."""
        if points is None or not len(points):
            state = self.network.detect(np.zeros((0, 3)), t)
            found = state.points, state.foreground, state.features, state.detections
            return dict.fromkeys(self.rows, _arrays(*found))
        xyz = self.network.sample(points, t)
        proposals, probability, chosen = self._run(xyz)
        probability = probability.numpy()
        boxes = self.network.boxes(proposals, probability, xyz[0])
        return {
            name: _arrays(
                frame.xyz.numpy()[0],
                probability[frame.rows.numpy()[0]],
                frame.features.numpy()[0],
                boxes,
            )
            for name, frame in chosen.items()
        }


def _arrays(
    points: np.ndarray, foreground: np.ndarray, features: np.ndarray, found: Detections
) -> Arrays:
    arrays = {"points": points, "foreground": foreground, "features": features.astype(np.float16)}
    return {**arrays, **found._asdict()}


class StoredDetections:
    """Stored frames with the displacement that a tracker predicts, as a `DetectionProvider`.

    Args:
        network: its tracker was trained on the detector that made the frames; runs once a scene.
        folder: of `store_frames`, called with the tracker's number of points.
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
        name = self.network.tracker.config.fused_features
        with np.load(frame_path(self.folder, name, scene, t)) as file:
            found = Detections(file["boxes"], file["scores"], file["classes"])
            features = file["features"].astype(np.float32)
            return self.network.restored(file["points"], file["foreground"], features, found)
