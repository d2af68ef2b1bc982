"""Loads the networks from checkpoints: configuration, weights, and their consistency."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import keras

from common.config import from_dict
from common.errors import InputError
from models import checkpoint
from models.boxes.box_score import BoxScorer, load_scorer
from models.config import DetectorConfig, TrackerConfig
from models.detector import Detector
from models.tracker import TrackingNetwork
from models.weight_files import network_files

Network = TypeVar("Network", bound=keras.Model)
CONFIGS = {"detector": DetectorConfig, "tracker": TrackerConfig}


def read_network(path: str | Path, kind: str) -> tuple[dict[str, Any], Any, dict[str, Any]]:
    """(meta, configuration of the network, arrays of the group "model") of a checkpoint.

    Raises:
        InputError: missing, broken, or of another kind.
    """
    meta, arrays = checkpoint.load(path, kind)
    config = from_dict(CONFIGS[kind], meta.get("network"), path)
    return meta, config, {name: a for name, a in arrays.items() if name.startswith("model/")}


def _restored(path: str | Path, arrays: dict[str, Any], make: Callable[[], Network]) -> Network:
    """The network that `make` builds, with these arrays; errors of both name the file."""
    try:
        network = make()
    except InputError as error:
        raise InputError(str(error), path) from error
    checkpoint.restore(path, arrays, model=checkpoint.named_variables(network))
    return network


def network_hash(network: keras.Model) -> str:
    """The content hash of a network's variables."""
    return checkpoint.content_hash(checkpoint.named_variables(network))


def load_detector(path: str | Path) -> Detector:
    """The detector of a checkpoint, rebuilt from the configuration in it.

    Raises:
        InputError: missing, broken, of another kind, or weights that do not fit.
    """
    _, config, arrays = read_network(path, "detector")
    return _restored(path, arrays, lambda: Detector(config))


def load_tracker(path: str | Path, detector: Detector) -> TrackingNetwork:
    """The tracker of a checkpoint that was trained on this detector.

    Raises:
        InputError: as load_detector, or the tracker was trained on another detector.
    """
    meta, config, arrays = read_network(path, "tracker")
    if meta.get("detector_sha256") != network_hash(detector):
        raise InputError("this tracker was trained on another detector", path)
    return _restored(path, arrays, lambda: TrackingNetwork(detector.config, config))


def load_networks(folder: str | Path) -> tuple[Detector, TrackingNetwork, BoxScorer | None]:
    """detector.npz, tracker.npz and, where it is there, scorer.json of a folder like weights/."""
    paths = network_files(folder)
    detector = load_detector(paths[0])
    tracker = load_tracker(paths[1], detector)
    return detector, tracker, load_scorer(folder, network_hash(detector))
