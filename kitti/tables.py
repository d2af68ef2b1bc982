"""Text tables: the whole file at once, with the faulty line named when something is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from common.errors import InputError


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of tokens that all have the same number of columns.

    Attributes:
        path: the file they come from, for messages.
        columns: one tuple of str per column, each of R tokens.
        lines: (R,) int64, the 1-based line number of each row.
    """

    path: Path
    columns: tuple[tuple[str, ...], ...]
    lines: np.ndarray

    def __len__(self) -> int:
        return len(self.lines)

    def error(self, message: str, row: int) -> InputError:
        """The `InputError` that names the line of `row`."""
        return InputError(message, self.path, int(self.lines[row]))

    def refuse(self, bad: np.ndarray, message: str) -> None:
        """Raises `InputError` at the first row where `bad` (R,) holds, if there is one."""
        if bad.any():
            raise self.error(message, int(np.argmax(bad)))

    def numbers(self, first: int, last: int) -> np.ndarray:
        """Columns `first` to `last` (not included) as (R, last - first) float64, all finite."""
        wanted = self.columns[first:last]
        try:
            if any("_" in token for column in wanted for token in column):
                raise ValueError("Python reads 1_0 as a number, KITTI does not")
            count = len(self) * len(wanted)
            flat = np.fromiter(map(float, chain.from_iterable(wanted)), np.float64, count)
        except ValueError:
            self._blame(first, last)
            raise
        values = flat.reshape(len(wanted), len(self)).T
        if not np.isfinite(flat).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            found = wanted[column][row]
            raise self.error(
                f"column {first + column + 1}: expected a finite number, found {found!r}", row
            )
        return values

    def integers(self, column: int, name: str) -> np.ndarray:
        """One column as (R,) int32; `name` is used in messages."""
        values = self.numbers(column, column + 1)[:, 0]
        bad = (values != np.rint(values)) | (np.abs(values) >= 2**31)
        self.refuse(bad, f"column {column + 1}: expected an integer {name}")
        return values.astype(np.int32)

    def _blame(self, first: int, last: int) -> None:
        for row in range(len(self)):
            for column in range(first, last):
                token = self.columns[column][row]
                try:
                    good = "_" not in token and float(token) is not None
                except ValueError:
                    good = False
                if not good:
                    raise self.error(
                        f"column {column + 1}: expected a number, found {token!r}", row
                    )


def read_bytes(path: str | Path) -> bytes:
    """The content of `path`.

    Raises:
        InputError: it does not exist, is not a regular file, or cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError("expected a file, found a directory", path)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", path) from error


def read_lines(path: str | Path) -> list[str]:
    """The lines of a plain ASCII text file, without their ends.

    Raises:
        InputError: as `read_bytes`, or a byte that is not ASCII (KITTI's files hold none).
    """
    data = read_bytes(path)
    if not data.isascii():
        at = next(i for i, byte in enumerate(data) if byte > 127)
        line = data.count(b"\n", 0, at) + 1
        raise InputError(f"expected plain text, found byte 0x{data[at]:02x}", path, line)
    return data.decode("ascii").split("\n")


def read_table(path: str | Path, widths: tuple[int, ...], separator: str | None = None) -> Table:
    """Reads a table whose rows all have the same one of the `widths`; blank lines are skipped.

    Args:
        path: a plain ASCII text file.
        widths: the numbers of columns that are allowed.
        separator: None for white space, or a character such as ",".

    Raises:
        InputError: the file cannot be read, or a row has another number of columns.
    """
    lines = read_lines(path)
    rows = [line.split(separator) for line in lines]
    numbers = [i for i, line in enumerate(lines, 1) if line.strip()]
    rows = [rows[i - 1] for i in numbers]
    found = set(map(len, rows))
    if len(found) > 1 or not found <= set(widths):
        width = len(rows[0]) if len(rows[0]) in widths else widths[-1]
        at = next(i for i, row in enumerate(rows) if len(row) != width)
        expected = " or ".join(map(str, widths)) if width != len(rows[0]) else str(width)
        raise InputError(f"expected {expected} columns, found {len(rows[at])}", path, numbers[at])
    columns = tuple(zip(*rows, strict=True)) if rows else tuple(() for _ in range(max(widths)))
    return Table(Path(path), columns, np.array(numbers, np.int64))
