"""Cache of the networks' outputs on disk: one pass over a scene serves every tracker and picture.

The name of a file is a digest of weights, data and code: a second run reuses it, a run with
others writes another one. TensorFlow is imported only where the networks have to run.

Letters: F frames, R boxes of all frames, n points of a frame, C channels of the appearance.
"""

import hashlib
import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import cache, cached_property
from importlib import metadata
from pathlib import Path
from time import perf_counter

import numpy as np

from common.files import write_arrays
from common.imports import imported_files
from common.progress import Progress
from common.provenance import ROOT
from evaluation.detections import NetworkDetections
from evaluation.scene import Scene
from models.weight_files import SCORER, network_files
from tracking.frame_detections import FrameDetections

FORMAT = 5
PACKAGES = ("numpy", "shapely", "tensorflow", "keras")
BOXES = ("boxes", "scores", "types", "appearance")
MOTION = ("points", "displacement", "foreground")


@cache
def code_digest() -> bytes:
    """Digest of all code that shapes the outputs: files, compiled ops, package versions."""
    library = os.environ.get("TF_OPS_LIBRARY", ROOT / "tf_ops" / "build" / "libtf_ops.so")
    paths = [*imported_files("evaluation.detections"), Path(__file__), Path(library)]
    digest = hashlib.blake2b(digest_size=16)
    for path in paths:
        digest.update(_digest_of_file(path) if path.is_file() else b"none")
    digest.update(repr([metadata.version(name) for name in PACKAGES]).encode())
    return digest.digest()


class CachedPredictions:
    """A `DetectionProvider` that reads the networks' outputs, and first makes those it lacks.

    Args:
        folder: of the files.
        weights: folder with detector.npz, tracker.npz and perhaps scorer.json.
    """

    def __init__(self, folder: str | Path, weights: str | Path):
        self.folder, self.weights = Path(folder), Path(weights)

    @cached_property
    def _network(self):
        loaded = NetworkDetections.load(self.weights)
        loaded.network = Stopwatch(loaded.network)
        loaded.network.warm_up()
        return loaded

    @cached_property
    def _code_and_weights(self) -> bytes:
        paths = network_files(self.weights)
        scorer = self.weights / SCORER
        paths += [scorer] * scorer.is_file()
        return b"".join(_digest_of_file(path) for path in paths) + code_digest()

    def path(self, scene: Scene) -> Path:
        """The file of a scene, whether it exists yet or not."""
        digest = hashlib.blake2b(self._code_and_weights, digest_size=8)
        shift = None if scene.shift is None else sorted(asdict(scene.shift).items())
        digest.update(repr((FORMAT, shift)).encode())
        digest.update(digest_of_data(scene))
        return self.folder / f"{scene.name}-{digest.hexdigest()}.npz"

    def fill(self, scene: Scene, each_frame: Callable[[], None] = lambda: None) -> bool:
        """Runs the networks over a scene unless its file exists; returns whether they ran."""
        path = self.path(scene)
        if _read(path) is not None:
            return False
        self._make(path, scene, each_frame)
        return True

    def _make(
        self, path: Path, scene: Scene, each_frame: Callable[[], None] = lambda: None
    ) -> None:
        scene.check(poses=False, scans=True)
        stopwatch = self._network.network
        stopwatch.seconds = []
        frames = []
        for detections in self._network.frames(scene):
            frames.append(detections)
            each_frame()
        _write(path, frames, stopwatch.seconds)

    def fill_all(self, scenes: Sequence[Scene], title: str) -> None:
        """Runs the networks over every scene that has no file yet, under a progress bar."""
        with Progress(sum(len(scene.frames) for scene in scenes), title, "frames") as bar:
            for scene in scenes:
                if not self.fill(scene, bar.update):
                    bar.update(len(scene.frames))

    def frames(self, scene: Scene) -> Iterator[FrameDetections]:
        """See `DetectionProvider.frames`."""
        arrays = self._arrays(scene)
        boxes = np.concatenate([[0], np.cumsum(arrays["box_count"])])
        points = np.concatenate([[0], np.cumsum(arrays["point_count"])])
        mask = np.concatenate([[0], np.cumsum(arrays["mask_count"])])
        for i, t in enumerate(scene.frames):
            rows, part = slice(boxes[i], boxes[i + 1]), slice(points[i], points[i + 1])
            found = {name: arrays[name][part] for name in MOTION} if i else {}
            found |= {name: arrays[name][rows] for name in BOXES}
            yield FrameDetections(t, **found, mask=arrays["mask"][mask[i] : mask[i + 1]])

    def seconds(self, scene: Scene) -> np.ndarray:
        """(F, 3) float64: of each frame, detector, tracker network, pooling of the appearance."""
        return self._arrays(scene)["seconds"]

    def _arrays(self, scene: Scene) -> dict[str, np.ndarray]:
        path = self.path(scene)  # a digest of every scan: once
        found = _read(path)
        if found is None:
            self._make(path, scene)
            found = _read(path)
        return found


class Stopwatch:
    """A `StreamingNetwork` whose calls are timed; a `detect` begins a frame.

    `seconds` holds for each frame those of `detect`, `displacement` and `appearance`.
    """

    def __init__(self, network):
        self.network, self.detector = network, network.detector
        self.seconds: list[list[float]] = []

    def warm_up(self) -> None:
        """Runs two frames of random points: measured times then exclude tracing."""
        points = np.random.default_rng(0).uniform((5, -20, -2), (60, 20, 1), (20000, 3))
        previous, current = (self.network.detect(points, t) for t in (0, 1))
        self.network.displacement(previous, current)

    def detect(self, points, t: int = 0):
        """See `StreamingNetwork.detect`."""
        start = perf_counter()
        state = self.network.detect(points, t)
        self.seconds.append([perf_counter() - start, 0.0, 0.0])
        return state

    def displacement(self, previous, current) -> np.ndarray:
        """See `StreamingNetwork.displacement`."""
        start = perf_counter()
        result = self.network.displacement(previous, current)
        self.seconds[-1][1] = perf_counter() - start
        return result

    def appearance(self, state, boxes) -> np.ndarray:
        """See `StreamingNetwork.appearance`."""
        start = perf_counter()
        result = self.network.appearance(state, boxes)
        self.seconds[-1][2] = perf_counter() - start
        return result


def _write(path: Path, frames: list[FrameDetections], seconds: list[list[float]]) -> None:
    nothing = np.zeros((0, 3))
    points = [nothing if f.points is None else f.points for f in frames]
    displacement = [nothing if f.points is None else f.displacement for f in frames]
    foreground = [nothing[:, 0] if f.points is None else f.foreground for f in frames]
    write_arrays(
        path,
        box_count=[len(f) for f in frames],
        boxes=np.concatenate([f.boxes for f in frames]),
        scores=np.concatenate([f.scores for f in frames]),
        types=np.concatenate([f.types for f in frames]).astype("<U16"),
        appearance=_same_width([f.appearance for f in frames]).astype(np.float32),
        point_count=[len(part) for part in points],
        points=np.concatenate(points).astype(np.float32),
        foreground=np.concatenate(foreground).astype(np.float32),
        displacement=np.concatenate(displacement).astype(np.float32),
        mask_count=[len(f.mask) for f in frames],
        mask=np.concatenate([f.mask for f in frames]).astype(np.float32),
        seconds=np.array(seconds).reshape(-1, 3),
    )


def _same_width(parts: list[np.ndarray]) -> np.ndarray:
    """Rows (R, C); a frame without points has rows of zeros, of another width."""
    width = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts])


def _read(path: Path) -> dict[str, np.ndarray] | None:
    """The arrays of a cache file; None if it is missing or incomplete."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return None


def _digest_of_file(path: Path) -> bytes:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).digest()


def digest_of_data(scene: Scene) -> bytes:
    """Digest (16 bytes) of labels, calibration, scans and the image that crops them."""
    sequence = scene.sequence
    digest = hashlib.blake2b(repr((scene.frames, sequence.image_size)).encode(), digest_size=16)
    files = [sequence.calib_path, sequence.label_path]
    files += [sequence.scan_path(t) for t in sequence.frames]
    for path in files:
        digest.update(_digest_of_file(path) if path.is_file() else b"none")
    return digest.digest()
