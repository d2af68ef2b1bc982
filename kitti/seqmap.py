"""Sequence maps (`evaluate_tracking.seqmap*`): how many frames each sequence has."""

from __future__ import annotations

from pathlib import Path

from common.errors import InputError
from common.files import write_text
from kitti.splits import sequence_name
from kitti.tables import read_table

SEQMAP = "evaluate_tracking.seqmap"
_ENDINGS = {"training": (".training", ""), "testing": (".testing", ".test", "")}


def find_seqmap(data_root: str | Path, subset: str) -> Path | None:
    """The seqmap of `subset`: in `data_root/subset` or `data_root`, with or without an ending."""
    for folder in (Path(data_root) / subset, Path(data_root)):
        for ending in _ENDINGS[subset]:
            path = folder / (SEQMAP + ending)
            if path.is_file():
                return path
    return None


def read_seqmap(path: str | Path) -> dict[int, int]:
    """Reads rows `0016 empty 000000 000209` -> {16: 209}: sequence number -> frames.

    Raises:
        InputError: wrong columns, a first frame that is not 0, no frames, a sequence named twice.
    """
    table = read_table(path, (4,), text_column=1)
    seqs, first, last = (table.integers(column, "number") for column in (0, 2, 3))
    table.refuse(seqs < 0, "column 1: expected a sequence number >= 0")
    table.refuse(first != 0, "column 3: expected first frame 0")
    table.refuse(last <= 0, "column 4: expected a number of frames above 0")
    frames: dict[int, int] = {}
    for row, (seq, count) in enumerate(zip(seqs.tolist(), last.tolist(), strict=True)):
        if seq in frames:
            raise table.error(f"sequence {sequence_name(seq)} is there twice", row)
        frames[seq] = count
    return frames


def write_seqmap(data_root: str | Path, subset: str, frames: dict[int, int]) -> Path:
    """Writes {sequence number: frames} as `data_root/subset/evaluate_tracking.seqmap.<subset>`."""
    path = Path(data_root) / subset / f"{SEQMAP}.{subset}"
    rows = (f"{sequence_name(seq)} empty 000000 {frames[seq]:06d}\n" for seq in sorted(frames))
    write_text(path, "".join(rows))
    return path


def frames_in_seqmap(data_root: str | Path, subset: str, seq: int) -> int | None:
    """Frames of `seq` by the seqmap of `subset`; None without a seqmap or if it lacks `seq`."""
    path = find_seqmap(data_root, subset)
    return None if path is None else read_seqmap(path).get(seq)


def check_subset(subset: str) -> str:
    """`subset` itself; InputError unless it is "training" or "testing"."""
    if subset not in _ENDINGS:
        raise InputError(f"subset: expected training or testing, found {subset!r}")
    return subset
