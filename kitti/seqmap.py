"""Numbers of sequences, their splits, and sequence maps (`evaluate_tracking.seqmap*`)."""

import os
import re
from pathlib import Path

from common.errors import InputError
from common.files import write_text
from common.notes import note
from kitti.labels import MAX_FRAMES
from kitti.tables import read_table

VAL = tuple(range(16, 21))
"""Validation sequences 0016-0020 of the labelled 21."""
TEST = tuple(range(29))
"""The benchmark's 29 testing sequences 0000-0028, without labels."""
MAX_SEQ = 9999
"""Largest number of a sequence: names have four digits."""
SEQMAP = "evaluate_tracking.seqmap"
_ENDINGS = {
    "training": (".training", "", ".txt", ".trainval", ".val", ".train", ".training_minus_val"),
    "testing": (".testing", ".test", "", ".txt"),
}
"""By subset, the most general first; those of splits are TrackEval's and AB3DMOT's."""

_PART = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?", re.ASCII)


def sequence_name(seq: int) -> str:
    """16 -> "0016", as KITTI names files and folders."""
    return f"{seq:04d}"


def parse_sequences(text: str) -> list[int]:
    """Reads `0016-0020`, `0000,0003` or a mixture; the order written is kept.

    Raises:
        InputError: another form, a descending range, or a repeated sequence.
    """
    found: list[int] = []
    for part in text.split(","):
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise InputError(f"sequences: expected such as 0016-0020 or 0000,0003, found {text!r}")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise InputError(f"sequences: range {part.strip()!r} runs backwards")
        found.extend(range(first, last + 1))
    if len(set(found)) < len(found):
        raise InputError(f"sequences: expected each one once, found {text!r}")
    return found


def _seqmaps(data_root: str | Path, subset: str) -> list[Path]:
    """The seqmaps of `subset` in `data_root/subset` and `data_root`; notes those of other names."""
    found, known = [], {SEQMAP + ending for each in _ENDINGS.values() for ending in each}
    for folder in (Path(data_root) / subset, Path(data_root)):
        paths = (folder / (SEQMAP + ending) for ending in _ENDINGS[subset])
        found += [path for path in paths if os.path.lexists(path)]
        for path in sorted(folder.glob("*seqmap*")):
            if path.name not in known:
                endings = ", ".join(ending for ending in _ENDINGS[subset] if ending)
                note(f"{path}: is not read; expected {SEQMAP}, perhaps with {endings}")
    return found


def read_seqmap(path: str | Path) -> dict[int, range]:
    """Reads rows `0016 empty 000000 000209` -> {16: range(209)}: sequence number -> frames.

    The last column is the number of frames where the first frame is 0, as in KITTI's own files;
    where a sequence begins later (half sequences), it is the last frame, as the devkit counts:
    `0000 empty 000077 000153` -> {0: range(77, 154)}.

    Raises:
        InputError: wrong columns, no frames or too many, a repeated sequence.
    """
    table = read_table(path, (4,), text_column=1)
    seqs, first, last = (table.integers(column, "number") for column in (0, 2, 3))
    table.refuse(seqs < 0, "column 1: expected a sequence number >= 0")
    table.refuse(first < 0, "column 3: expected a first frame >= 0")
    table.refuse((first == 0) & (last <= 0), "column 4: expected a number of frames above 0")
    table.refuse((first > 0) & (last < first), "column 4: expected a last frame from column 3 on")
    table.refuse(last > MAX_FRAMES, f"column 4: expected at most {MAX_FRAMES} frames")
    frames: dict[int, range] = {}
    for row, (seq, begin, end) in enumerate(
        zip(*(c.tolist() for c in (seqs, first, last)), strict=True)
    ):
        if seq in frames:
            raise table.error(f"sequence {sequence_name(seq)} is there twice", row)
        frames[seq] = range(begin, end + 1 if begin else end)
    return frames


def write_seqmap(data_root: str | Path, subset: str, frames: dict[int, int]) -> Path:
    """Writes {sequence number: frames} as `data_root/subset/evaluate_tracking.seqmap.<subset>`."""
    path = Path(data_root) / subset / f"{SEQMAP}.{subset}"
    rows = (f"{sequence_name(seq)} empty 000000 {frames[seq]:06d}\n" for seq in sorted(frames))
    write_text(path, "".join(rows))
    return path


def find_seqmap(data_root: str | Path, subset: str, seq: int) -> tuple[Path, range] | None:
    """The first seqmap of `subset` that holds `seq`, and its frames; None without one.

    Notes seqmaps that are not used, and a sequence that none of them holds.
    """
    paths = _seqmaps(data_root, subset)
    for i, path in enumerate(paths):
        frames = read_seqmap(path)
        if seq in frames:
            if paths[i + 1 :]:
                others = ", ".join(map(str, paths[i + 1 :]))
                note(f"{path}: the frames of its sequences are taken from it, not from {others}")
            return path, frames[seq]
    if paths:
        lacking = f"sequence {sequence_name(seq)} is not in it, its frames are not limited"
        note(f"{paths[0]}: {lacking}")
    return None


def check_subset(subset: str) -> str:
    """`subset` itself; InputError unless it is "training" or "testing"."""
    if subset not in _ENDINGS:
        raise InputError(f"subset: expected training or testing, found {subset!r}")
    return subset
