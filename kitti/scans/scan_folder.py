"""A folder of scans: frame numbers from file names."""

import re
from collections import Counter
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

from common.errors import InputError
from common.notes import note
from kitti.scans.scan_files import SUFFIXES

MAX_FRAME_NUMBER = 10**6
"""Larger numbers are times, which define the order alone, unless some are consecutive."""
MAX_SPAN = 100_000
"""Most frames from the first scan to the last."""
_NUMBER = re.compile(r"(\d+)(?:([._-])(\d+))?(\D*)", re.ASCII)
_FRACTION = re.compile(r"\d\.\d+\D*\Z", re.ASCII)
_NANOSECONDS = 9  # digits
_DEPTH = 3  # of folders that are searched for scans, for the message
_DATE = re.compile(  # year, month, day, hour, minute, second, fraction
    r"\D*(\d{4})[-_]?(\d\d)[-_]?(\d\d)[-_T ]+(\d\d)[-_:]?(\d\d)[-_:]?(\d\d)(?:[._,-](\d{1,9}))?\D*",
    re.ASCII,
)
_DIGITS = re.compile(  # the same in one number
    r"\D*(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)(?:[._,-]?(\d{1,9}))?\D*", re.ASCII
)
_LEAST, _MOST = (1, 1, 0, 0, 0), (12, 31, 23, 59, 60)  # month, day, hour, minute, second
_TIMES = "names are times; they give the order, and gaps are not known"


def find_scans(folder: str | Path) -> dict[int, Path]:
    """Frame number -> scan, ascending.

    Names are frame numbers of any width (000007, 7, 0000000007), with an optional text that is the
    same in all names (scan_7, 0016_7); a missing number is a frame without a scan. From 10^6 on
    consecutive numbers (1000007, 1000008) are counted from the first. Times (other numbers from
    10^6 on, two numbers such as seconds.nanoseconds, or dates such as 2011-09-26_13-02-25) are
    sorted and numbered from 0. A single scan may have any name: the last number in it is the frame,
    0 without one and for a time (also any number from 10^6 on). Hidden files are ignored.

    Raises:
        InputError: the folder is missing or has no scan; files of several formats; names without a
            number, of several kinds or sequences, or with the same number.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"--scans: expected a directory with {SUFFIXES[0]} files", folder)
    paths = [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
    ]
    if not paths:
        expected = f"--scans: found no {SUFFIXES[0]} file ({' '.join(SUFFIXES)})"
        raise InputError(f"{expected}{_instead(folder)}", folder)
    kinds = sorted({path.suffix.lower() for path in paths})
    if len(kinds) > 1:
        raise InputError(f"--scans: expected files of one format, found {' '.join(kinds)}", folder)
    if len(paths) == 1:
        return _single(paths[0])
    return _by_dates(paths) or _numbered(paths)


def _instead(folder: Path) -> str:
    """What a folder without scans holds: folders with scans, or the most frequent suffix."""
    below = _below(folder)
    if below:
        others = f" and {len(below) - 1} others" * (len(below) > 1)
        return f"; there are scans in {below[0].relative_to(folder)}/{others}: give one such folder"
    inside = _visible(folder)
    suffixes = Counter("".join(path.suffixes).lower() for path in inside if path.is_file())
    if not suffixes:
        return ""
    ((suffix, count),) = suffixes.most_common(1)
    hint = (
        "unpack them" if suffix.endswith((".gz", ".zip")) else "convert them, for instance to .npy"
    )
    return f", but {count} {suffix or 'without an ending'}: {hint}"


def _below(folder: Path) -> list[Path]:
    """The folders with scans at the least depth below a folder, as in velodyne_points/data/."""
    level = [folder]
    for _ in range(_DEPTH):
        level = [path for above in level for path in _visible(above) if path.is_dir()]
        found = [
            path for path in level if any(p.suffix.lower() in SUFFIXES for p in _visible(path))
        ]
        if found:
            return found
    return []


def _visible(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return []


def _single(path: Path) -> dict[int, Path]:
    numbers = [int(digits) for digits in re.findall(r"\d+", path.stem, re.ASCII)] or [0]
    is_time = _date(path) or _FRACTION.search(path.stem) or max(numbers) >= MAX_FRAME_NUMBER
    return {0 if is_time else numbers[-1]: path}


def _date(path: Path) -> re.Match[str] | None:
    return _DATE.fullmatch(path.stem) or _DIGITS.fullmatch(path.stem)


def _by_dates(paths: list[Path]) -> dict[int, Path] | None:
    """Names that are dates with times such as 2011-09-26_13-02-25.123, in order; else None."""
    matches = [_date(path) for path in paths]
    if not all(matches):
        return None
    keys = [(*map(int, match.groups()[:6]), Decimal(f"0.{match[7] or 0}")) for match in matches]
    if not all(
        a <= n <= b for key in keys for a, n, b in zip(_LEAST, key[1:6], _MOST, strict=True)
    ):
        return None
    _check_fractions(paths, [match[7] or "" for match in matches])
    if len(set(keys)) < len(keys):
        raise InputError("--scans: two scans have the same time", paths[0].parent)
    note(f"{paths[0].parent}: {_TIMES}")
    order = sorted(zip(keys, paths, strict=True))
    return {frame: path for frame, (_, path) in enumerate(order)}


def _numbered(paths: list[Path]) -> dict[int, Path]:
    """Two scans or more by frame number."""
    matches = _matches(paths)
    separators = {match[2] for match in matches}
    if len(separators) > 1:
        odd = next(p for p, m in zip(paths, matches, strict=True) if m[2] != matches[0][2])
        raise InputError(f"--scans: expected names like {paths[0].name}, found {odd.name}", odd)
    keys = [_key(match) for match in matches]
    if separators == {"."}:
        _check_fractions(paths, [match[3] for match in matches])
    order = sorted(range(len(paths)), key=keys.__getitem__)
    for before, after in pairwise(order):
        if keys[before] == keys[after]:
            names = f"{paths[before].name} and {paths[after].name}"
            raise InputError(f"--scans: {names} have the same number", paths[after].parent)
    smallest, largest = keys[order[0]][0], keys[order[-1]][0]
    span = largest - smallest + 1
    counted = any(keys[after][0] - keys[before][0] == 1 for before, after in pairwise(order))
    if separators == {None} and largest >= MAX_FRAME_NUMBER and counted and span <= MAX_SPAN:
        note(f"{paths[0].parent}: frame 0 is {paths[order[0]].name}")
        return {keys[i][0] - smallest: paths[i] for i in order}
    if separators != {None} or largest >= MAX_FRAME_NUMBER:
        _check_times(paths, matches)
        return {frame: paths[i] for frame, i in enumerate(order)}
    if span > MAX_SPAN:
        ends = f"{paths[order[0]].name} to {paths[order[-1]].name}"
        raise InputError(
            f"--scans: {ends} are {span} frames, expected at most {MAX_SPAN}", paths[0].parent
        )
    if not counted and len(paths) > 2:
        names = ", ".join(paths[i].name for i in order[:3])
        note(
            f"{paths[0].parent}: no scan follows another ({names}, ...), so that nothing can be "
            "tracked over the gaps; if these are all scans, number them from 0 on"
        )
    return {int(keys[i][0]): paths[i] for i in order}


def _matches(paths: list[Path]) -> list[re.Match[str]]:
    """The numbers in the names, after the text that all names begin with."""
    first, last = min(path.stem for path in paths), max(path.stem for path in paths)
    same = (i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b)
    begin = first[: next(same, len(first))].rstrip("0123456789")
    begin = begin if _is_label(begin) else ""
    matches = [_NUMBER.fullmatch(path.stem[len(begin) :]) for path in paths]
    for path, match in zip(paths, matches, strict=True):
        if match is None:
            raise InputError(
                "--scans: expected names that are numbers, such as 000007 or 1317617735.25, "
                f"found {path.name}",
                path.parent,
            )
        if match[4] != matches[0][4]:
            names = f"{paths[0].name} and {path.name}"
            raise InputError(f"--scans: expected names of one kind, found {names}", path.parent)
    return matches


def _is_label(begin: str) -> bool:
    """True if a common prefix is not part of a time: text, or small numbers such as 0000_."""
    if re.search(r"[^\d._-]", begin, re.ASCII):
        return True
    numbers = re.findall(r"\d+", begin, re.ASCII)
    return begin.endswith(("_", "-")) and all(int(n) < MAX_FRAME_NUMBER for n in numbers)


def _check_times(paths: list[Path], matches: list[re.Match[str]]) -> None:
    """Refuses pairs of small numbers such as sequence_frame, which are not times; notes times."""
    numbers = [int(n) for match in matches for n in (match[1], match[3] or 0)]
    if matches[0][2] in ("_", "-") and max(numbers) < MAX_FRAME_NUMBER:
        names = f"{paths[0].name} to {paths[-1].name}"
        raise InputError(
            f"--scans: {names} are of several sequences, expected those of one", paths[0].parent
        )
    note(f"{paths[0].parent}: {_TIMES}")


def _key(match: re.Match[str]) -> tuple:
    if match[2] == ".":
        return (Decimal(f"{match[1]}.{match[3]}"),)
    return (int(match[1]), int(match[3] or 0))


def _check_fractions(paths: list[Path], digits: list[str]) -> None:
    """Refuses fractions of a second without leading zeros, which do not sort as decimals.

    Those of a float, such as 0.5 and 0.25, do; they never end in 0.
    """
    widths = [len(each) for each in digits]
    whole = any(len(each) > 1 and each.endswith("0") for each in digits)
    if len(set(widths)) > 1 and (whole or max(widths) >= _NANOSECONDS):
        odd = paths[widths.index(min(widths))]
        expected = f"expected {max(widths)} digits after the point in every name"
        raise InputError(f"--scans: {expected}, found {odd.name}", odd.parent)
