"""What the networks said about a scene, kept on disk: one pass serves every tracker and picture.

A recording is named by everything it depends on, so a second run finds it and a run with other
weights, data or code does not. TensorFlow is imported only where something is to be recorded.

Letters: F frames, R boxes of all frames, n points of a frame, C channels of the appearance.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from time import perf_counter

import numpy as np

from common.errors import InputError
from common.files import atomic_path
from common.progress import Progress
from common.provenance import ROOT
from evaluation.scene import Scene
from evaluation.sources import MOTION, BoxSource, Detected, GroundTruthBoxes, motion_of
from kitti.labels import VEHICLES

FORMAT = 2
SOURCES = (
    "models/*.py",
    "kitti/object_shift.py",
    "kitti/footprints.py",
    "evaluation/network.py",
    "evaluation/recording.py",
)
"""The code whose outputs are recorded."""


class RecordedNetwork:
    """A `BoxSource` that replays the networks' outputs, recording what is not there yet.

    Args:
        folder: of the recordings.
        weights: folder with detector.npz and tracker.npz.
        boxes: where boxes come from instead of the detector, if given.
        boxes_name: what `boxes` are, as part of the recording's name.
    """

    def __init__(
        self,
        folder: str | Path,
        weights: str | Path,
        boxes: BoxSource | None = None,
        boxes_name: str = "network",
    ):
        self.folder, self.weights = Path(folder), Path(weights)
        self.boxes, self.boxes_name = boxes, boxes_name

    @cached_property
    def _network(self):
        from evaluation.network import NetworkBoxes  # TensorFlow only where it is needed

        loaded = NetworkBoxes.load(self.weights, self.boxes)
        loaded.network = Stopwatch(loaded.network)
        loaded.network.warm_up()
        return loaded

    @cached_property
    def _code_and_weights(self) -> bytes:
        paths = [self.weights / "detector.npz", self.weights / "tracker.npz"]
        for path in paths:
            if not path.is_file():
                raise InputError("expected a checkpoint file", path)
        paths += [path for pattern in SOURCES for path in sorted(ROOT.glob(pattern))]
        return b"".join(_digest_of_file(path) for path in paths)

    def path(self, scene: Scene) -> Path:
        """Where the recording of a scene is, or is due."""
        digest = hashlib.blake2b(self._code_and_weights, digest_size=8)
        model = None if scene.model is None else sorted(asdict(scene.model).items())
        digest.update(repr((FORMAT, self.boxes_name, model)).encode())
        digest.update(_digest_of_data(scene))
        return self.folder / f"{scene.name}-{digest.hexdigest()}.npz"

    def record(self, scene: Scene, each_frame: Callable[[], None] = lambda: None) -> bool:
        """Runs the networks over a scene unless a recording is there; whether they ran."""
        path = self.path(scene)
        if _read(path) is not None:
            return False
        stopwatch = self._network.network
        stopwatch.seconds = []
        frames = []
        for detected in self._network.frames(scene):
            frames.append(detected)
            each_frame()
        _write(path, frames, stopwatch.seconds)
        return True

    def record_all(self, scenes: Sequence[Scene], title: str) -> None:
        """Records every scene that has no recording yet, under a progress bar."""
        with Progress(sum(scene.num_frames for scene in scenes), title, "frames") as bar:
            for scene in scenes:
                if not self.record(scene, bar.update):
                    bar.update(scene.num_frames)

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        arrays = self._arrays(scene)
        boxes = np.concatenate([[0], np.cumsum(arrays["box_count"])])
        points = np.concatenate([[0], np.cumsum(arrays["point_count"])])
        for t in range(len(boxes) - 1):
            rows = slice(boxes[t], boxes[t + 1])
            extras = {"types": arrays["types"][rows], "appearance": arrays["appearance"][rows]}
            if t:
                part = slice(points[t], points[t + 1])
                extras.update({key: arrays[key][part] for key in MOTION})
            yield t, arrays["boxes"][rows], arrays["scores"][rows], extras

    def seconds(self, scene: Scene) -> np.ndarray:
        """(F, 2) float64: time of the detector's and of the tracker's pass in each frame."""
        return self._arrays(scene)["seconds"]

    def _arrays(self, scene: Scene) -> dict[str, np.ndarray]:
        self.record(scene)
        return _read(self.path(scene))


class TrueBoxes:
    """A `BoxSource`: the labelled vehicles' boxes, with the displacement of recorded networks."""

    def __init__(self, recorded: RecordedNetwork):
        self.recorded, self.labelled = recorded, GroundTruthBoxes(VEHICLES)

    def frames(self, scene: Scene) -> Iterator[Detected]:
        """See `BoxSource.frames`."""
        pairs = zip(self.labelled.frames(scene), self.recorded.frames(scene), strict=True)
        for (t, boxes, scores, extras), (*_, network) in pairs:
            yield t, boxes, scores, {**extras, **motion_of(network)}


class Stopwatch:
    """A `StreamingNetwork` whose calls are timed; a `detect` begins a frame.

    `seconds` holds a pair for each frame: of `detect`, of the `displacement` to that frame.
    """

    def __init__(self, network):
        self.network, self.detector = network, network.detector
        self.seconds: list[list[float]] = []

    def warm_up(self) -> None:
        """Two frames of random points, so that no time holds the making of the graphs."""
        points = np.random.default_rng(0).uniform((5, -20, -2), (60, 20, 1), (20000, 3))
        previous, current = (self.network.detect(points, t) for t in (0, 1))
        self.network.displacement(previous, current)

    def detect(self, points, t: int = 0):
        """See `StreamingNetwork.detect`."""
        start = perf_counter()
        state = self.network.detect(points, t)
        self.seconds.append([perf_counter() - start, 0.0])
        return state

    def displacement(self, previous, current) -> np.ndarray:
        """See `StreamingNetwork.displacement`."""
        start = perf_counter()
        result = self.network.displacement(previous, current)
        self.seconds[-1][1] = perf_counter() - start
        return result


def _write(path: Path, frames: list[Detected], seconds: list[list[float]]) -> None:
    nothing = np.zeros((0, 3), np.float32)
    extras = [extra for *_, extra in frames]
    points = [extra.get("points", nothing) for extra in extras]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(
            file,
            box_count=[len(boxes) for _, boxes, _, _ in frames],
            boxes=np.concatenate([boxes for _, boxes, _, _ in frames]),
            scores=np.concatenate([scores for _, _, scores, _ in frames]),
            types=np.concatenate([extra["types"] for extra in extras]).astype("<U16"),
            appearance=_same_width([extra["appearance"] for extra in extras]),
            point_count=[len(part) for part in points],
            points=np.concatenate(points),
            foreground=np.concatenate([extra.get("foreground", nothing[:, 0]) for extra in extras]),
            displacement=np.concatenate([extra.get("displacement", nothing) for extra in extras]),
            seconds=np.array(seconds).reshape(-1, 2),
        )


def _same_width(parts: list[np.ndarray]) -> np.ndarray:
    """Rows (R, C); a frame without points has rows of zeros, of another width."""
    width = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts])


def _read(path: Path) -> dict[str, np.ndarray] | None:
    """The arrays of a recording; None if there is none that is whole."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None


def _digest_of_file(path: Path) -> bytes:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).digest()


def _digest_of_data(scene: Scene) -> bytes:
    """Of labels, calibration and scans; 16 bytes."""
    sequence = scene.sequence
    digest = hashlib.blake2b(str(scene.num_frames).encode(), digest_size=16)
    files = [sequence.folder / "calib" / f"{scene.name}.txt", sequence.label_path]
    files += [sequence.scan_path(t) for t in sequence.frames]
    for path in files:
        digest.update(_digest_of_file(path) if path.is_file() else b"none")
    return digest.digest()
