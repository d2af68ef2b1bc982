"""Keys and matrices of a calibration file as text, in the notations that converters use."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from common.errors import InputError
from kitti.tables import read_lines

_BETWEEN = re.compile(r"[\s,;:=\[\]]+")
_NUMBER = re.compile(r"[-+]?\.?\d")


def read_keys(path: str | Path) -> Iterator[tuple[int, str, list[str]]]:
    """Line number, key and values of each entry.

    Between them are white space, colons, commas or brackets; lines that begin with a number
    continue the entry before them.
    """
    entry: tuple[int, str, list[str]] | None = None
    for number, line in enumerate(read_lines(path), 1):
        words = [word for word in _BETWEEN.split(line) if word]
        if words and _NUMBER.match(words[0]) is None:
            if entry is not None:
                yield entry
            entry = (number, words[0], words[1:])
        elif entry is not None:
            entry[2].extend(words)
    if entry is not None:
        yield entry


def read_matrix(
    name: str, words: list[str], shape: tuple[int, int], path: str | Path, line: int
) -> np.ndarray:
    """The values of an entry as a matrix of finite numbers.

    A matrix of more rows or columns than `shape` is accepted if those are of the identity, as in a
    homogeneous (4, 4) matrix; a projection may lack its last column, which is zero then.

    Raises:
        InputError: another number of values, or no finite numbers.
    """
    try:
        values = np.array([np.nan if "_" in word else float(word) for word in words])
    except ValueError as error:
        raise InputError(f"{name}: expected numbers, {error}", path, line) from error
    if not np.isfinite(values).all():
        raise InputError(f"{name}: expected finite numbers", path, line)
    rows, columns = shape
    if len(values) == rows * columns:
        return values.reshape(shape)
    if columns in (3, 4) and len(values) in (12, 16):
        whole = np.vstack([values.reshape(-1, 4), np.eye(4)[len(values) // 4 :]])
        extended = np.eye(4)
        extended[:rows, :columns] = whole[:rows, :columns]
        if (whole == extended).all():
            return whole[:rows, :columns]
    if name.startswith("P") and len(values) == 9:
        return np.pad(values.reshape(3, 3), ((0, 0), (0, 1)))
    expected = f"expected {rows * columns} numbers"
    raise InputError(f"{name}: {expected}, found {len(values)}", path, line)
