"""Sequence numbers: the splits of the paper and the way they are written on a command line."""

from __future__ import annotations

import re

from common.errors import InputError

VAL = tuple(range(16, 21))
"""Validation sequences 0016-0020 of the labelled 21."""
TEST = tuple(range(29))
"""The benchmark's 29 testing sequences 0000-0028, without labels."""

_PART = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?", re.ASCII)


def sequence_name(seq: int) -> str:
    """16 -> "0016", as KITTI names files and folders."""
    return f"{seq:04d}"


def parse_sequences(text: str) -> list[int]:
    """Reads `0016-0020`, `0000,0003` or a mixture; the order written is kept.

    Raises:
        InputError: not of that form, a range that runs backwards, or a sequence named twice.
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
