"""Point clouds of other projects as arrays: .npy (NumPy), .pcd (PCL), .ply (Stanford)."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.npy import parse_npy
from kitti.scans.ply import parse_ply
from kitti.scans.point_text import numbered_lines, parse_lines

_COMPRESSION = 300  # at most, of LZF: three bytes encode 264
_MAX_HEADER = 10_000  # bytes


def parse_cloud(data: bytes, suffix: str, path: str | Path) -> np.ndarray:
    """The content of a file as an array, plain (.npy) or structured, by its suffix.

    Raises:
        InputError: another format, a truncated file, more points declared than stored, or the
            reader's package is not installed.
    """
    try:
        return CLOUD_PARSERS[suffix](data)
    except InputError:
        raise
    except ImportError as error:  # a package may be missing from an installation
        needed = f"reading {suffix} needs the package {error.name}: pip install {error.name}"
        raise InputError(needed, path) from error
    except Exception as error:  # the libraries raise many types on damaged files
        reason = _reason(error)
        raise InputError(f"not a whole {suffix} file: {reason[:200]}", path) from error


def _reason(error: Exception) -> str:
    """One sentence; of the header's first fault where pydantic has found several."""
    if hasattr(error, "errors"):
        first = error.errors()[0]
        return f"{' '.join(map(str, first['loc'])).upper()}: {first['msg']}"
    return str(error) or type(error).__name__


def _parse_pcd(data: bytes) -> np.ndarray:
    from pypcd4 import Encoding, MetaData, PointCloud

    lines, body = _pcd_header(data)
    meta = MetaData.parse_header(lines)
    each = 1 if meta.data == Encoding.ASCII else meta.build_dtype().itemsize
    packed = meta.data not in (Encoding.ASCII, Encoding.BINARY)
    if meta.points * each > len(data) * (_COMPRESSION if packed else 1):
        raise ValueError(f"{meta.points} points declared in {len(data)} bytes")
    if meta.data == Encoding.ASCII:
        rows = numbered_lines(data, len(data) - len(body))
        return parse_lines(rows, meta.points, meta.build_dtype())
    whole = "\n".join([*lines, ""]).encode() + body
    points = np.atleast_1d(PointCloud.from_fileobj(io.BytesIO(whole)).pc_data)
    if len(points) != meta.points:
        raise ValueError(f"{meta.points} points declared, {len(points)} found")
    return points


def _pcd_header(data: bytes) -> tuple[list[str], bytes]:
    """Header lines with the defaults of those that PCL can do without; the rest of the file."""
    words, start = {}, 0
    while "DATA" not in words:
        end = data.find(b"\n", start, _MAX_HEADER)
        if end < 0:
            raise ValueError("no line DATA")
        name, *values = data[start:end].decode("ascii", "replace").split() or ["#"]
        words |= {} if name.startswith("#") else {name: values}
        start = end + 1
    missing = [name for name in ("FIELDS", "SIZE", "TYPE", "WIDTH") if name not in words]
    if missing:
        raise ValueError(f"no line {missing[0]}")
    words.setdefault("COUNT", ["1"] * len(words["FIELDS"]))
    for name in ("SIZE", "TYPE", "COUNT"):
        if len(words[name]) != len(words["FIELDS"]):
            expected = f"expected {len(words['FIELDS'])} words as in FIELDS"
            raise ValueError(f"line {name}: {expected}, found {len(words[name])}")
    words.setdefault("HEIGHT", ["1"])
    words.setdefault("POINTS", [str(int(words["WIDTH"][0]) * int(words["HEIGHT"][0]))])
    words["VERSION"] = ["0.7"]  # earlier ones differ in the header alone
    words["TYPE"] = [word.upper() for word in words["TYPE"]]
    words["DATA"] = [word.lower() for word in words.pop("DATA")]  # the last line
    return [" ".join([name, *values]) for name, values in words.items()], data[start:]


CLOUD_PARSERS: dict[str, Callable[[bytes], np.ndarray]] = {
    ".npy": parse_npy,
    ".pcd": _parse_pcd,
    ".ply": parse_ply,
}
"""By suffix."""
