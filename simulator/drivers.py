"""The two sources of a data set: own traffic, and the trajectories of real label files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.files import write_bytes
from kitti.sequence import KittiSequence
from simulator.config import SENSOR, VehicleMix
from simulator.drives.drive import DriveWorld, drive
from simulator.drives.motion_files import write_oxts
from simulator.drives.replay import Replay, replay
from simulator.plan import Builder, Plan
from simulator.sensor_model.scan import Scene, Sweep


@dataclass(frozen=True)
class LabelWorld:
    """A labelled sequence as a `simulator.plan.World`; its text files are the source's."""

    sequence: KittiSequence
    replay: Replay

    @property
    def calib(self):
        """The source's calibration."""
        return self.sequence.calib

    @property
    def image_size(self) -> tuple[int, int]:
        """The source's image size."""
        return self.sequence.image_size

    @property
    def poses(self) -> np.ndarray:
        """(F, 4, 4) level-frame poses."""
        return self.replay.poses

    def scene(self, frame: int, motion: bool) -> Scene:
        """The scene of `frame`."""
        return self.replay.scene(frame, motion)

    def labels(self, frame: int, sweep: Sweep) -> None:
        """None: the source's labels are copied."""

    def write_texts(self, root: Path, name: str, frames: int) -> None:
        """Copies calibration, and of labels and poses the lines of the first `frames`, byte for
        byte; writes oxts from the poses."""
        source = self.sequence
        labels = source.label_path.read_bytes().splitlines(keepends=True)
        labels = [line for line in labels if line.strip() and int(line.split()[0]) < frames]
        write_bytes(root / "label_02" / f"{name}.txt", b"".join(labels))
        calib = (source.folder / "calib" / f"{name}.txt").read_bytes()
        write_bytes(root / "calib" / f"{name}.txt", calib)
        poses = source.data_root / "poses" / f"{name}.txt"
        if poses.is_file():
            lines = poses.read_bytes().splitlines(keepends=True)[:frames]
            write_bytes(root.parent / "poses" / f"{name}.txt", b"".join(lines))
        write_oxts(root / "oxts" / f"{name}.txt", self.poses[:frames], SENSOR.period_s)


def _from_labels(plan: Plan, seq: int) -> LabelWorld:
    sequence = KittiSequence(plan.spec["from_labels"], seq)
    rng = np.random.default_rng((plan.seed, seq, 2**20))
    return LabelWorld(sequence, replay(sequence, rng))


def _own_traffic(plan: Plan, seq: int) -> DriveWorld:
    mix = VehicleMix.with_vans(plan.spec.get("van_share"))
    return drive(plan.frames[seq], np.random.default_rng((plan.seed, seq, 2**21)), mix)


DRIVERS: dict[str, Builder] = {"labels": _from_labels, "traffic": _own_traffic}
