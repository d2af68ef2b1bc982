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
            if any("_" in " ".join(column) for column in wanted):
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
        InputError: the file cannot be read, a row has another number of columns, or the last
            line has neither an end nor as many decimals as all others (a file cut off).
    """
    lines = read_lines(path)
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line and line.strip()]
    numbers = [i for i, _ in numbered]
    rows = [line.split(separator) for _, line in numbered]
    found = set(map(len, rows))
    if len(found) > 1 or not found <= set(widths):
        width = len(rows[0]) if len(rows[0]) in widths else widths[-1]
        at = next(i for i, row in enumerate(rows) if len(row) != width)
        expected = " or ".join(map(str, widths)) if width != len(rows[0]) else str(width)
        raise InputError(f"expected {expected} columns, found {len(rows[at])}", path, numbers[at])
    columns = tuple(zip(*rows, strict=True)) if rows else tuple(() for _ in range(max(widths)))
    table = Table(Path(path), columns, np.array(numbers, np.int64))
    if len(rows) > 1 and numbers[-1] == len(lines):
        _refuse_cut_number(table)
    return table


def _refuse_cut_number(table: Table) -> None:
    """Called if the last line has no end: is its last number shorter than all those above it?"""
    decimals = [len(token.partition(".")[2]) for token in table.columns[-1]]
    if len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]:
        found = table.columns[-1][-1]
        raise table.error(f"the file is cut off: its last number is {found!r}", len(table) - 1)
