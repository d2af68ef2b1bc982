"""One sequence of a data set in KITTI's tracking layout, opened lazily."""

import os
import re
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.notes import note
from kitti.calibration import LEVEL_FROM_CAMERA, Calibration, is_rotation, read_calibration
from kitti.camera_view import GUESSED, describe_image_size, in_camera_view
from kitti.check_rows import note_numbering, note_projection
from kitti.detections import read_detection_folder
from kitti.labels import MAX_FRAMES, MAX_NUMBER, Limit, read_labels, read_results
from kitti.objects import Objects
from kitti.scans.scan_files import read_scan
from kitti.seqmap import check_subset, find_seqmap, sequence_name
from kitti.tables import read_table, text_file

POSE_COLUMNS = 12  # of a row of poses: a (3, 4) matrix
_SEQS = "--seqs names those that are there"


class KittiSequence:
    """Sequence `seq` of `data_root/subset`.

    A seqmap (`evaluate_tracking.seqmap*` in data_root or data_root/subset, see `kitti.seqmap`)
    defines its frames; without one they are 0 to the last labelled frame (the benchmark's 8008
    frames), without labels (testing) 0 to the last numbered scan. Scan files are not counted: a
    missing scan (0001/177-180) is a frame without a scan. Rows of labels, detections and results
    outside the frames of a seqmap (a half sequence) are omitted.

    Args:
        data_root: folder that holds `training/` or `testing/`.
        seq: sequence number.
        subset: "training" or "testing".
        image_size: pixels of its images, where the calibration does not define them.

    Raises:
        InputError: the folder, or labels, seqmap and scans of the sequence are missing.
    """

    def __init__(
        self,
        data_root: str | Path,
        seq: int,
        subset: str = "training",
        image_size: tuple[int, int] | None = None,
    ):
        self.data_root, self.seq, self.subset = Path(data_root), seq, check_subset(subset)
        self._given_size = image_size
        self.name = sequence_name(seq)
        self.folder = self.data_root / subset
        if not self.folder.is_dir():
            hint = _instead(self.data_root, subset)
            raise InputError(f"expected a folder {subset}/ in KITTI's layout{hint}", self.data_root)
        if self.subset == "training" and not self.label_path.exists():
            hint = f"; {_SEQS}"
            if (self.folder / "label_2").is_dir():
                hint = "; label_2/ is the object benchmark's, whose frames do not follow"
            raise InputError(f"sequence {self.name} has no label file{hint}", self.label_path)

    def __repr__(self) -> str:
        return f"KittiSequence({str(self.data_root)!r}, {self.seq}, {self.subset!r})"

    @property
    def label_path(self) -> Path:
        """Path of the label file, `.txt` or `.txt.gz`."""
        return text_file(self.folder / "label_02", self.name)

    @property
    def calib_path(self) -> Path:
        """Path of the calibration, `.txt` or `.txt.gz`."""
        return text_file(self.folder / "calib", self.name)

    @property
    def poses_path(self) -> Path:
        """Path of the poses, `.txt` or `.txt.gz`, whether they exist or not."""
        return text_file(self.data_root / "poses", self.name)

    @cached_property
    def _seqmap(self) -> tuple[Path, range] | None:
        return find_seqmap(self.data_root, self.subset, self.seq)

    @cached_property
    def frames(self) -> range:
        """All frame numbers, with or without scan."""
        if self._seqmap is not None:
            return self._seqmap[1]
        if self.subset == "training":
            return range(self._labelled_frames)
        numbers = [
            int(path.stem)
            for path in self._scan_folder.glob("*.bin")
            if re.fullmatch(r"\d{6}", path.stem, re.ASCII)
        ]
        if not numbers:
            raise InputError(
                f"sequence {self.name} has neither seqmap nor scans; {_SEQS}", self._scan_folder
            )
        if max(numbers) >= MAX_FRAMES:
            raise InputError(
                f"expected scans of frames 0 to {MAX_FRAMES - 1}, found {max(numbers)}",
                self._scan_folder,
            )
        return range(max(numbers) + 1)

    @property
    def _labelled_frames(self) -> int:
        """Frames up to the last labelled one; notes a scan that comes after it."""
        last = int(self.objects.frame[-1])
        if self.has_scan(last + 1):
            note(
                f"{self.label_path}: the labels end at frame {last}, the scans do not; those after "
                "it are left out (a seqmap sets the frames, see docs/DATA.md)"
            )
        return last + 1

    @property
    def num_frames(self) -> int:
        """Number of the last frame, plus one."""
        return self.frames.stop

    @cached_property
    def calib(self) -> Calibration:
        """The sequence's calibration."""
        return read_calibration(self.calib_path)

    @cached_property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the left colour image in pixels; see `describe_image_size`.

        Notes a guessed size. Raises InputError where there is none.
        """
        calib = self.calib
        try:
            size, source = describe_image_size(calib, self._given_size)
        except InputError as error:
            raise InputError(str(error), self.calib_path) from error
        if source == GUESSED:
            text = f"images of {size[0]}x{size[1]} pixels, {source}; S_rect_02 in it sets another"
            note(f"{self.calib_path}: {text}")
        return size

    @cached_property
    def objects(self) -> Objects:
        """The labelled objects, DontCare included; none for the testing subset."""
        if self.subset == "testing":
            return Objects.empty()
        if self._seqmap is None:
            return read_labels(self.label_path)
        return self._in_frames(read_labels(self.label_path, MAX_FRAMES), self.label_path)

    def read_results(self, path: str | Path) -> Objects:
        """A tracker's result file of this sequence, see `kitti.labels.read_results`."""
        rows = self._in_frames(read_results(path, self._limit), path)
        return self._compared(rows, path)

    def read_detections(self, folder: str | Path, alone: bool = False) -> Objects:
        """The sequence's detections in a folder, see `kitti.detections.read_detection_folder`."""
        rows = read_detection_folder(folder, self.name, self._limit, alone)
        return self._compared(self._in_frames(rows, folder), folder)

    def _compared(self, rows: Objects, path: str | Path) -> Objects:
        """The rows; notes boxes of another frame of coordinates or of another numbering."""
        if self.subset == "training":
            note_numbering(rows, self.objects, path)
        if self.calib_path.is_file():  # 2-D metrics need none
            note_projection(rows, self.calib, self.image_size, path)
        return rows

    def check_scans(self) -> None:
        """Notes frames without a scan.

        Raises:
            InputError: none has one: a wrong folder, or files of other names.
        """
        missing = sum(not self.has_scan(t) for t in self.frames)
        if 0 < missing < len(self.frames):
            note(f"{self._scan_folder}: {missing} of {len(self.frames)} frames have no scan")
        if missing == len(self.frames):
            last = self.frames.stop - 1
            expected = f"{self.frames.start:06d}.bin to {last:06d}.bin"
            raise InputError(f"expected scans such as {expected}, found none", self._scan_folder)

    @property
    def _limit(self) -> Limit:
        """Upper bound of the frame numbers in detections and results."""
        if self.subset == "testing":
            return Limit(self.num_frames)
        if self._seqmap is None:
            return Limit(self.num_frames, f"where the labels {self.label_path} end")
        labelled = read_labels(self.label_path, MAX_FRAMES).frame.max(initial=-1) + 1
        end = f"where the seqmap {self._seqmap[0]} ends"
        return Limit(max(self.num_frames, int(labelled)), end)

    def _in_frames(self, rows: Objects, path: str | Path) -> Objects:
        inside = (rows.frame >= self.frames.start) & (rows.frame < self.frames.stop)
        if inside.all():
            return rows
        span = f"{self.frames.start} to {self.frames.stop - 1}"
        note(f"{path}: {int((~inside).sum())} rows outside the seqmap's frames {span} are left out")
        return rows[inside]

    @property
    def _scan_folder(self) -> Path:
        return self.folder / "velodyne" / self.name

    def scan_path(self, t: int) -> Path:
        """Path of the scan of frame `t`."""
        return self._scan_folder / f"{t:06d}.bin"

    def has_scan(self, t: int) -> bool:
        """True if frame `t` has a scan."""
        return self.scan_path(t).is_file()

    def read_points_level(self, t: int, crop: bool = True) -> np.ndarray:
        """The scan of frame `t`: (n, 4) float32 x, y, z (metres, level frame), intensity.

        `crop` keeps only the points in the view of the left colour camera.
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

    @property
    def has_poses(self) -> bool:
        """True if there is a file of poses."""
        return self.subset == "training" and os.path.lexists(self.poses_path)

    @cached_property
    def poses(self) -> np.ndarray | None:
        """(F or more, 4, 4) float64: level frame of frame t -> level frame of frame 0.

        From `data_root/poses/00XX.txt` (KITTI odometry's layout, camera 0); None without it.
        The published poses are of the training sequences, so testing has none.
        """
        path = self.poses_path
        if path.parent.exists() and not path.parent.is_dir():
            raise InputError("expected a folder with files 00XX.txt, found a file", path.parent)
        if not self.has_poses:
            if self.subset == "training" and path.parent.is_dir():
                note(f"{path.parent}: there is no {path.name}, so the ego motion is unknown")
            return None
        table = read_table(path, (POSE_COLUMNS,))
        if len(table) < self.num_frames:
            expected = f"expected {self.num_frames} rows (a pose per frame), found {len(table)}"
            raise InputError(expected, path)
        turn = np.eye(4)
        turn[:3, :3] = LEVEL_FROM_CAMERA
        poses = np.tile(np.eye(4), (len(table), 1, 1))
        poses[:, :3] = table.numbers(0, POSE_COLUMNS).reshape(-1, 3, 4)
        table.refuse(~is_rotation(poses[:, :3, :3]), "its 3x3 block is not a rotation")
        far = (np.abs(poses[:, :3, 3]) > MAX_NUMBER).any(axis=1)
        table.refuse(far, f"expected a position within {MAX_NUMBER:.0e} metres")
        return turn @ poses @ turn.T


def _instead(data_root: Path, subset: str) -> str:
    """Where a folder without `subset` has what belongs there, for the message; "" if nowhere."""
    if (data_root / "label_02").is_dir():
        above = "give the folder above this one"
        return f": {above}" if data_root.name == subset else f": label_02/ belongs into {subset}/"
    below = sorted(path.parent.name for path in data_root.glob(f"*/{subset}"))
    if not below:
        return ""
    others = f" and {len(below) - 1} others: put them into one folder"
    return f"; there is one in {below[0]}/{others if below[1:] else ': give that folder'}"


def open_sequences(
    data_root: str | Path,
    seqs: Sequence[int],
    subset: str = "training",
    image_size: tuple[int, int] | None = None,
) -> list[KittiSequence]:
    """Opens several sequences; raises InputError if one is missing."""
    return [KittiSequence(data_root, seq, subset, image_size) for seq in seqs]


def labelled_sequences(data_root: str | Path) -> list[int]:
    """Numbers of all sequences of data_root/training that have a label file; InputError if none."""
    folder = Path(data_root) / "training" / "label_02"
    names = {path.name[:4] for path in folder.glob("[0-9][0-9][0-9][0-9].txt*")}
    numbers = sorted(int(name) for name in names if text_file(folder, name).exists())
    if not numbers:
        raise InputError("expected label files such as 0000.txt", folder)
    return numbers
