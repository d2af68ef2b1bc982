"""Description of a data set: source, sequences, options and paths of its files."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from kitti.calibration import Calibration
from kitti.objects import Objects
from kitti.seqmap import sequence_name
from simulator import VERSION
from simulator.config import RETURNS, SENSOR, SIZES
from simulator.sensor_model.frames import Options
from simulator.sensor_model.scan import Scene, Sweep


class World(Protocol):
    """The world of one sequence, the source of its frames; cached by each process."""

    calib: Calibration
    image_size: tuple[int, int]
    poses: Any  # (F, 4, 4)

    def scene(self, frame: int, motion: bool) -> Scene:
        """The scene of `frame`."""

    def labels(self, frame: int, sweep: Sweep) -> Objects | None:
        """Label rows of `frame`; None if `write_texts` writes them."""

    def write_texts(self, root: Path, name: str, frames: int) -> None:
        """Writes the text files (calibration, oxts, poses, labels) of the first `frames`."""


@dataclass(frozen=True)
class Plan:
    """A data set: `driver` is a key of `simulator.drivers.DRIVERS`, `spec` its settings as JSON
    values, `frames` the number of frames of each sequence."""

    driver: str
    spec: dict[str, Any]
    seed: int
    frames: dict[int, int]
    options: Options

    def has_poses(self, seq: int) -> bool:
        """Whether the data set has poses of a sequence: replays only where their source has."""
        return self.driver != "labels" or f"poses/{sequence_name(seq)}" in self.spec["files"]

    def manifest(self) -> dict[str, Any]:
        """Identity of the data set: the same manifest gives the same bytes.

        The path in the spec of a replay is a record; the digests beside it identify the source.
        """
        return {
            "format": "KITTI tracking, simulated",
            "version": VERSION,
            "driver": self.driver,
            "spec": self.spec,
            "seed": self.seed,
            "frames": {sequence_name(seq): count for seq, count in self.frames.items()},
            "options": asdict(self.options),
            "sensor": asdict(SENSOR),
            "returns": asdict(RETURNS),
            "sizes": asdict(SIZES),
        }


Builder = Callable[[Plan, int], World]


def scan_path(root: Path, seq: int, frame: int) -> Path:
    """Path of a scan in KITTI's layout."""
    return root / "training" / "velodyne" / sequence_name(seq) / f"{frame:06d}.bin"


def part_path(root: Path, seq: int, frame: int) -> Path:
    """Path of one frame's labels until all frames of the sequence are complete."""
    return root / ".parts" / sequence_name(seq) / f"{frame:06d}.txt"


def label_path(root: Path, seq: int) -> Path:
    """Path of a sequence's labels in KITTI's layout."""
    return root / "training" / "label_02" / f"{sequence_name(seq)}.txt"
