"""The networks from their checkpoints: configuration, weights, and that the two belong together."""

from __future__ import annotations

from pathlib import Path

from common.config import from_dict
from common.errors import InputError
from models.box_coding import head_channels
from models.config import DetectorConfig, TrackerConfig
from models.detector import Detector
from models.tracker import Tracker, tracker_channels
from training import checkpoint
from training.config import DetectorTrainingConfig, TrackerTrainingConfig


def _load(path: str | Path, kind: str):
    meta, arrays = checkpoint.load(path)
    if meta.get("kind") != kind:
        raise InputError(f"expected a {kind} checkpoint, found {meta.get('kind')!r}", path)
    model = {name: array for name, array in arrays.items() if name.startswith("model/")}
    return meta, model


def load_detector(path: str | Path) -> Detector:
    """The detector of a checkpoint, rebuilt from the configuration in it.

    Raises:
        InputError: missing, broken, of another kind, or weights that do not fit.
    """
    meta, arrays = _load(path, "detector")
    config: DetectorConfig = from_dict(DetectorTrainingConfig, meta["config"], path).detector
    detector = Detector(config)
    checkpoint.restore(path, arrays, model=detector.weights)
    return detector


def load_tracker(path: str | Path, detector: Detector) -> Tracker:
    """The tracker of a checkpoint that was trained on this detector.

    Raises:
        InputError: as load_detector, or the tracker was trained on another detector.
    """
    meta, arrays = _load(path, "tracker")
    trained_on = meta.get("detector_sha256")
    if trained_on != checkpoint.content_hash(detector.weights):
        raise InputError("this tracker was trained on another detector", path)
    config: TrackerConfig = from_dict(TrackerTrainingConfig, meta["config"], path).tracker
    channels = tracker_channels(config, detector.config, head_channels(detector.config.box))
    tracker = Tracker(channels, config)
    checkpoint.restore(path, arrays, model=tracker.weights)
    return tracker


def load_networks(folder: str | Path) -> tuple[Detector, Tracker]:
    """detector.npz and tracker.npz of a folder such as weights/."""
    detector = load_detector(Path(folder) / "detector.npz")
    return detector, load_tracker(Path(folder) / "tracker.npz", detector)
