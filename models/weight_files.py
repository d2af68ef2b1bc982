"""The network files of a folder of weights; without TensorFlow, which takes seconds to import."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from common.errors import InputError
from models.boxes.box_score import FILE_NAME as SCORER

DETECTOR, TRACKER = "detector.npz", "tracker.npz"


def network_files(folder: str | Path) -> list[Path]:
    """Paths of detector and tracker; raises InputError where one is missing."""
    paths = [Path(folder) / DETECTOR, Path(folder) / TRACKER]
    for path in paths:
        if not path.is_file():
            raise InputError("expected a checkpoint file, as training.export writes it", path)
    return paths


def weights_sha256(
    folder: str | Path, names: Iterable[str] = (DETECTOR, TRACKER, SCORER)
) -> dict[str, str]:
    """SHA-256 of detector, tracker and scorer, those of them that a folder of weights holds."""
    paths = [Path(folder) / name for name in names]
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in paths if p.is_file()}
