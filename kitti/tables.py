"""Text tables: NumPy parses the whole file; on failure a second pass finds the faulty line."""

import codecs
import gzip
import io
import itertools
import os
import zlib
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import read_bytes

MAX_TEXT_BYTES = 2**28
_GZIP = b"\x1f\x8b"
_EXACT = 2.0**53  # from here on float64 does not hold every integer
_TEXT = "<U16"  # longer than KITTI's names: a longer word is cut and stays unknown


@dataclass(frozen=True, eq=False)
class Table:
    """R rows of numbers, all of one width, perhaps with one column of text.

    Attributes:
        path: of the file, for messages.
        source: all lines of the file; those that are not blank are the rows.
        values: (R, width) float64, all finite; 0 in the column of text.
        text: (R,) str, the column of text; empty strings without one.
        separator: of the columns; None for white space.
    """

    path: Path
    source: list[str]
    values: np.ndarray
    text: np.ndarray
    separator: str | None = None

    def __len__(self) -> int:
        return len(self.values)

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.values.shape[1]

    @property
    def rows(self) -> list[str]:
        """The lines that are not blank, a row each."""
        return [line for line in self.source if line.strip()]

    def error(self, message: str, row: int) -> InputError:
        """The `InputError` that names the line of `row`."""
        numbers = (i for i, line in enumerate(self.source, 1) if line.strip())
        return InputError(message, self.path, next(itertools.islice(numbers, row, None)))

    def refuse(self, bad: np.ndarray, message: str) -> None:
        """Raises `InputError` at the first row where `bad` (R,) holds, if there is one."""
        if bad.any():
            raise self.error(message, int(np.argmax(bad)))

    def numbers(self, first: int, last: int) -> np.ndarray:
        """Columns `first` to `last` (not included) as (R, last - first) float64."""
        return self.values[:, first:last]

    def integers(self, column: int, name: str, bits: int = 32) -> np.ndarray:
        """One column as (R,) int64, all of magnitude below 2^(bits - 1); `name` is for messages.

        Numbers that float64 cannot hold exactly are taken from the text.
        """
        values, expected = (
            self.values[:, column],
            f"column {column + 1}: expected an integer {name}",
        )
        self.refuse(values != np.rint(values), expected)
        large = np.flatnonzero(np.abs(values) >= _EXACT)
        if not len(large):
            self.refuse(np.abs(values) >= 2 ** (bits - 1), f"{expected} below 2^{bits - 1}")
            return values.astype(np.int64)
        exact = np.where(np.abs(values) < _EXACT, values, 0).astype(np.int64)
        rows = self.rows
        for row in large.tolist():
            number = int(Decimal(rows[row].split(self.separator)[column].strip()))
            if abs(number) >= 2 ** (bits - 1):
                raise self.error(f"{expected} below 2^{bits - 1}, found {number}", row)
            exact[row] = number
        return exact


def read_lines(path: str | Path) -> list[str]:
    """The lines of a plain ASCII text file, without their ends (LF, CRLF or CR).

    A file may be compressed by gzip, and may be UTF-8 or UTF-16 with a byte order mark.

    Raises:
        InputError: as `read_bytes`, or a byte that is not ASCII (KITTI's files hold none).
    """
    data = _plain(read_bytes(path, MAX_TEXT_BYTES), path)
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if not data.isascii() or b"\0" in data:
        at = next(i for i, byte in enumerate(data) if byte > 127 or byte == 0)
        line = data.count(b"\n", 0, at) + 1
        raise InputError(f"expected plain text, found byte 0x{data[at]:02x}", path, line)
    return data.decode("ascii").split("\n")


def _plain(data: bytes, path: str | Path) -> bytes:
    """The text of a file, unpacked from gzip, without a byte order mark."""
    try:
        if data.startswith(_GZIP):
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
                data = file.read(MAX_TEXT_BYTES + 1)
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            data = data.decode("utf-16").encode()
    except (OSError, EOFError, zlib.error, UnicodeError) as error:
        raise InputError(f"expected plain text: {error}", path) from error
    if len(data) > MAX_TEXT_BYTES:
        raise InputError(f"expected at most {MAX_TEXT_BYTES} bytes of text", path)
    return data.removeprefix(codecs.BOM_UTF8)


def text_file(folder: Path, name: str) -> Path:
    """`folder/NAME.txt`, or `folder/NAME.txt.gz` where only that exists."""
    path = folder / f"{name}.txt"
    packed = folder / f"{name}.txt.gz"
    return packed if packed.exists() and not os.path.lexists(path) else path


_BELOW = ("data", "data_0", "tracks")


def sequence_file(folder: str | Path, name: str) -> Path:
    """`folder/NAME.txt`, packed or not, or where that is missing the same in a folder below it.

    TrackEval keeps results in `data/`, AB3DMOT in `data_0/`, evaluate.py in `tracks/`.
    """
    places = [text_file(Path(folder) / below, name) for below in ("", *_BELOW)]
    return next((path for path in places if os.path.lexists(path)), places[0])


def columns_of(line: str) -> list[str]:
    """The columns of a line, between commas if it has one, else between white space."""
    return line.split(_separator(line))


def _separator(line: str) -> str | None:
    return "," if "," in line else None


def read_table(path: str | Path, widths: tuple[int, ...], text_column: int | None = None) -> Table:
    """Reads a table of rows of one width among `widths`; blank lines are skipped.

    Columns are between white space or, if the first row has one, between commas.

    Args:
        path: a plain ASCII text file.
        widths: the numbers of columns that are allowed.
        text_column: the column that holds a word; all others hold finite numbers.

    Raises:
        InputError: the file cannot be read, a row has another number of columns, a value is not a
            finite number, or the file is truncated: the last line has no end and its last number
            fewer decimals than the fixed number of those above it.
    """
    source = read_lines(path)
    rows = [line for line in source if line and not line.isspace()]
    separator = _separator(rows[0]) if rows else None
    width = len(rows[0].split(separator)) if rows else max(widths)
    parsed = _parse(rows, width, separator, text_column) if width in widths else None
    if parsed is None:
        zeros = np.zeros((len(rows), width)), np.zeros(len(rows), _TEXT)
        blank = Table(Path(path), source, *zeros, separator)
        words = [line.split(separator) for line in rows]
        _refuse_other_widths(blank, words, widths)
        _refuse_words(blank, words, text_column)
        raise InputError("expected a table of numbers", path)
    if len(rows) > 1 and source[-1].strip():
        last = [line.split(separator)[-1] for line in rows]
        _refuse_cut_number(Table(Path(path), source, *parsed), last)
    return Table(Path(path), source, *parsed, separator)


def _parse(
    rows: list[str], width: int, separator: str | None, text_column: int | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Values (R, width) and text (R,) of a faultless table; None if there is any fault."""
    kinds = [_TEXT if i == text_column else np.float64 for i in range(width)]
    dtype = np.dtype([(f"c{i}", kind) for i, kind in enumerate(kinds)])
    if not rows:
        return np.zeros((0, width)), np.zeros(0, _TEXT)
    try:
        table = np.loadtxt(rows, dtype, delimiter=separator, comments=None, ndmin=1)
    except ValueError:
        return None
    values, text = np.zeros((len(table), width)), np.zeros(len(table), _TEXT)
    for i in range(width):
        if i == text_column:
            text = np.char.strip(table[f"c{i}"])
        else:
            values[:, i] = table[f"c{i}"]
    return (values, text) if np.isfinite(values).all() else None


def _refuse_other_widths(table: Table, rows: list[list[str]], widths: tuple[int, ...]) -> None:
    expected = (len(rows[0]),) if len(rows[0]) in widths else widths
    for i, row in enumerate(rows):
        if len(row) not in expected:
            allowed = " or ".join(map(str, expected))
            between = "white space" if table.separator is None else repr(table.separator)
            found = f"found {len(row)} (between columns: {between})"
            raise table.error(f"expected {allowed} columns, {found}", i)


def _refuse_words(table: Table, rows: list[list[str]], text_column: int | None) -> None:
    for i, row in enumerate(rows):
        for column, token in enumerate(row):
            if column == text_column:
                continue
            expected = f"column {column + 1}: expected a"
            try:
                value = np.nan if "_" in token else float(token)
            except ValueError:
                raise table.error(f"{expected} number, found {token!r}", i) from None
            if not np.isfinite(value):
                raise table.error(f"{expected} finite number, found {token!r}", i)


def _refuse_cut_number(table: Table, tokens: list[str]) -> None:
    """Refuses a last line without an end whose last number is shorter than a fixed width.

    All others have the same number of decimals, and one ends in 0: a writer that rounds leaves
    such zeros out, and its last number may be the shortest by chance.
    """
    decimals = [len(token.partition(".")[2]) for token in tokens]
    padded = decimals[0] > 1 and any(token.endswith("0") for token in tokens[:-1])
    if padded and len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]:
        message = f"the file is cut off: its last number is {tokens[-1]!r}"
        raise table.error(message, len(table) - 1)
