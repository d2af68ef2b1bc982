"""Points as lines of numbers: the bodies of ascii .pcd and .ply files."""

import itertools
from collections.abc import Iterator

import numpy as np

Lines = Iterator[tuple[int, str]]
"""Line numbers of a file and lines."""


def numbered_lines(data: bytes, start: int) -> Lines:
    """The lines of `data` from byte `start` on that are not blank; a byte order mark is skipped."""
    text = data[start:].removeprefix(b"\xef\xbb\xbf").decode("ascii", "replace")
    first = data.count(b"\n", 0, start) + 1
    return ((i, line) for i, line in enumerate(text.splitlines(), first) if line.strip())


def parse_lines(lines: Lines, count: int, dtype: np.dtype) -> np.ndarray:
    """The next `count` lines as a structured array of `dtype`, a number between white space each.

    Raises:
        ValueError: too few lines, another number of words in a line, or no number.
    """
    taken = [(number, line.split()) for number, line in itertools.islice(lines, count)]
    wanted = len(dtype.names)
    for number, words in taken:
        if len(words) != wanted:
            raise ValueError(f"line {number}: expected {wanted} numbers, found {len(words)}")
    if len(taken) < count:
        raise ValueError(f"{count} points declared, {len(taken)} found")
    try:
        rows = np.array([words for _, words in taken], np.float64).reshape(count, wanted)
    except ValueError:
        raise ValueError(_no_number(taken)) from None
    found = np.zeros(count, dtype)
    with np.errstate(all="ignore"):
        for name, column in zip(dtype.names, rows.T, strict=True):
            found[name] = column
    return found


def _no_number(taken: list[tuple[int, list[str]]]) -> str:
    for number, words in taken:
        for word in words:
            try:
                float(word)
            except ValueError:
                return f"line {number}: expected a number, found {word[:40]!r}"
    return "expected numbers"
