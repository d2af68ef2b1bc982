"""Point clouds of other projects as arrays: .npy (NumPy), .pcd (PCL), .ply (Stanford)."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.npy import parse_npy
from kitti.scans.ply import parse_ply

_COMPRESSION = 300  # at most, of LZF: three bytes encode 264


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
        reason = str(error) or type(error).__name__
        raise InputError(f"not a whole {suffix} file: {reason[:200]}", path) from error


def _parse_pcd(data: bytes) -> np.ndarray:
    from pypcd4 import Encoding, MetaData, PointCloud

    header = []
    for line in io.BytesIO(data[:10_000]):
        header.append(line.decode("ascii").strip())
        if header[-1].startswith("DATA"):
            break
    meta = MetaData.parse_header([line for line in header if line and not line.startswith("#")])
    each = 1 if meta.data == Encoding.ASCII else meta.build_dtype().itemsize
    packed = meta.data not in (Encoding.ASCII, Encoding.BINARY)
    if meta.points * each > len(data) * (_COMPRESSION if packed else 1):
        raise ValueError(f"{meta.points} points declared in {len(data)} bytes")
    points = np.atleast_1d(PointCloud.from_fileobj(io.BytesIO(data)).pc_data)
    if len(points) != meta.points:
        raise ValueError(f"{meta.points} points declared, {len(points)} found")
    return points


CLOUD_PARSERS: dict[str, Callable[[bytes], np.ndarray]] = {
    ".npy": parse_npy,
    ".pcd": _parse_pcd,
    ".ply": parse_ply,
}
"""By suffix."""
