"""The network files of a folder of weights; without TensorFlow, which takes seconds to import."""

from pathlib import Path

from common.errors import InputError

DETECTOR, TRACKER = "detector.npz", "tracker.npz"


def network_files(folder: str | Path) -> list[Path]:
    """Paths of detector and tracker; raises InputError where one is missing."""
    paths = [Path(folder) / DETECTOR, Path(folder) / TRACKER]
    for path in paths:
        if not path.is_file():
            raise InputError("expected a checkpoint file, as training.export writes it", path)
    return paths
