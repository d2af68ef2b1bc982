"""One sequence of a data set in KITTI's tracking layout, opened lazily."""

from __future__ import annotations

from collections.abc import Sequence as Seq
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from common.errors import InputError
from kitti.calibration import LEVEL_FROM_CAMERA, Calibration, is_rotation, read_calibration
from kitti.image_size import image_size_of
from kitti.labels import read_labels
from kitti.objects import Objects
from kitti.scans import in_camera_view, read_scan
from kitti.seqmap import check_subset, frames_in_seqmap
from kitti.splits import sequence_name
from kitti.tables import read_table


class Sequence:
    """Sequence `seq` of `data_root/subset`.

    Its frames are 0 ... num_frames - 1. How many there are is known from a seqmap
    (`evaluate_tracking.seqmap[.training|.testing]` in data_root or data_root/subset), else from
    the last labelled frame (that gives the benchmark's 8008 frames), else, where there are no
    labels (testing), from the last numbered scan. Scan files are never counted: a scan that is
    missing (0001/177-180) is a frame without a scan.

    Args:
        data_root: folder that holds `training/` or `testing/`.
        seq: sequence number.
        subset: "training" or "testing".

    Raises:
        InputError: there is no such folder, nor labels, seqmap or scans of the sequence.
    """

    def __init__(self, data_root: str | Path, seq: int, subset: str = "training"):
        self.data_root, self.seq, self.subset = Path(data_root), seq, check_subset(subset)
        self.name = sequence_name(seq)
        self.folder = self.data_root / subset
        if not self.folder.is_dir():
            raise InputError(f"expected a folder {subset}/ in KITTI's layout", self.data_root)
        if self.subset == "training" and not self.label_path.exists():
            raise InputError(f"sequence {self.name} has no label file", self.label_path)

    def __repr__(self) -> str:
        return f"Sequence({str(self.data_root)!r}, {self.seq}, {self.subset!r})"

    @property
    def label_path(self) -> Path:
        """Where the labels are due."""
        return self.folder / "label_02" / f"{self.name}.txt"

    @cached_property
    def _seqmap_frames(self) -> int | None:
        return frames_in_seqmap(self.data_root, self.subset, self.seq)

    @cached_property
    def num_frames(self) -> int:
        """Number of frames, with or without scan."""
        if self._seqmap_frames is not None:
            return self._seqmap_frames
        if self.subset == "training":
            return int(self.objects.frame[-1]) + 1
        numbers = [
            int(path.stem) for path in self._scan_folder.glob("*.bin") if path.stem.isdigit()
        ]
        if not numbers:
            raise InputError(
                f"sequence {self.name} has neither seqmap nor scans", self._scan_folder
            )
        return max(numbers) + 1

    @property
    def frames(self) -> range:
        """All frame numbers."""
        return range(self.num_frames)

    @cached_property
    def calib(self) -> Calibration:
        """The sequence's calibration."""
        return read_calibration(self.folder / "calib" / f"{self.name}.txt")

    @cached_property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the left colour image in pixels (see `kitti.image_size`)."""
        return image_size_of(self.calib)

    @cached_property
    def objects(self) -> Objects:
        """The labelled objects, DontCare included; none for the testing subset."""
        if self.subset == "testing":
            return Objects.empty()
        return read_labels(self.label_path, self._seqmap_frames)

    @property
    def _scan_folder(self) -> Path:
        return self.folder / "velodyne" / self.name

    def scan_path(self, t: int) -> Path:
        """Where the scan of frame `t` is due."""
        return self._scan_folder / f"{t:06d}.bin"

    def has_scan(self, t: int) -> bool:
        """Whether frame `t` has a scan."""
        return self.scan_path(t).is_file()

    def read_points_level(self, t: int, crop: bool = True) -> np.ndarray:
        """The scan of frame `t`: (n, 4) float32 x, y, z (metres, level frame), intensity.

        `crop` keeps only the points that the left colour camera sees.
        """
        points = read_scan(self.scan_path(t))
        points[:, :3] = self.calib.velo_to_level(points[:, :3])
        if crop:
            points = points[in_camera_view(points, self.calib, self.image_size)]
        return points

    def pairs(self, scans: bool = True) -> list[tuple[int, int]]:
        """Adjacent frames (t - 1, t); with `scans` only those that both have a scan."""
        usable = [t for t in self.frames if not scans or self.has_scan(t)]
        return [(a, b) for a, b in pairwise(usable) if b == a + 1]

    @cached_property
    def poses(self) -> np.ndarray | None:
        """(F, 4, 4) float64: level frame of frame t -> level frame of frame 0.

        From `data_root/poses/00XX.txt` (KITTI odometry's layout, camera 0); None without it.
        The published poses are of the training sequences, so testing has none.
        """
        path = self.data_root / "poses" / f"{self.name}.txt"
        if self.subset == "testing" or not path.exists():
            return None
        table = read_table(path, (12,))
        if len(table) != self.num_frames:
            raise InputError(f"expected {self.num_frames} rows, found {len(table)}", path)
        turn = np.eye(4)
        turn[:3, :3] = LEVEL_FROM_CAMERA
        poses = np.tile(np.eye(4), (len(table), 1, 1))
        poses[:, :3] = table.numbers(0, 12).reshape(-1, 3, 4)
        table.refuse(~is_rotation(poses[:, :3, :3]), "its 3x3 block is not a rotation")
        return turn @ poses @ turn.T


def open_sequences(
    data_root: str | Path, seqs: Seq[int], subset: str = "training"
) -> list[Sequence]:
    """Opens several sequences; raises InputError at once if one is not there."""
    return [Sequence(data_root, seq, subset) for seq in seqs]
