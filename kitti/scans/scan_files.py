"""Reads and writes the files of scans."""

from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import read_bytes, write_bytes
from common.notes import note
from kitti.scans.cloud_files import CLOUD_PARSERS, parse_cloud
from kitti.scans.point_arrays import MAX_RANGE, as_points
from kitti.scans.scan_layout import KITTI_LAYOUT, ScanLayout, named_columns, raw_points

SUFFIXES = (".bin", *CLOUD_PARSERS)
"""Suffixes of the files that `read_points` reads."""


def read_points(
    path: str | Path, layout: ScanLayout = KITTI_LAYOUT, flags: bool = True
) -> tuple[np.ndarray, int]:
    """Reads a scan of any of `SUFFIXES`; returns its points and the number of points dropped.

    The points are (n, 4) float32: x, y, z (metres, frame of the scanner), and intensity, 0 where
    the file has none; `as_points` defines the dropped points. `flags`: errors name the flags of
    track.py that read other layouts.

    Raises:
        InputError: the file cannot be read, is empty, cut off, of another format or layout, or
            holds no finite point.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"expected a scan ending in {', '.join(SUFFIXES)}", path)
    data = read_bytes(path)
    if suffix == ".bin":
        array = raw_points(data, layout, path, flags)
    else:
        array = _cloud(parse_cloud(data, suffix, path), layout, path)
    try:
        points, dropped = as_points(array)
    except InputError as error:
        raise InputError(str(error), path) from error
    if points.shape[1] == 3:
        points = np.pad(points, ((0, 0), (0, 1)))
    return points, dropped


def _cloud(array: np.ndarray, layout: ScanLayout, path: str | Path) -> np.ndarray:
    """An array of a file with the columns and the unit of `layout`, for `as_points`."""
    if layout.dtype is not None:
        raise InputError("--scan_dtype: expected a .bin file, this format declares its types", path)
    if layout.columns is None and layout.scale == 1.0:
        return array
    names = array.dtype.names
    if names is not None:
        with np.errstate(invalid="ignore"):  # of signalling NaN
            array = np.stack([array[name].ravel() for name in names], axis=-1).astype(np.float64)
    elif array.ndim >= 2:
        array = array.reshape(-1, array.shape[-1])
    columns = layout.columns or tuple(names or "xyzi"[: array.shape[-1]])
    if array.ndim != 2 or array.shape[1] < len(columns):
        expected = f"{len(columns)} columns {','.join(columns)}"
        raise InputError(f"--scan_columns: expected {expected}, found shape {array.shape}", path)
    if "x" not in columns and "-x" not in columns:
        raise InputError(f"expected fields x, y, z, found {','.join(columns)}", path)
    return named_columns(array, columns, layout.scale)


def read_scan(path: str | Path) -> np.ndarray:
    """Reads a scan in KITTI's layout; (n, 4) float32 as `read_points`, which see for errors.

    Notes dropped points once for each folder. Errors name no flags: programs that read a data set
    have none for its layout.
    """
    points, dropped = read_points(path, flags=False)
    if dropped:
        note(f"{Path(path).parent}: points that are not finite or beyond {MAX_RANGE:.0f} m dropped")
    return points


def write_scan(path: str | Path, points: np.ndarray) -> None:
    """Writes (n, 4) points (Velodyne frame) as float32, atomically."""
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 4:
        raise ValueError(f"expected points of shape (n, 4), found {points.shape}")
    write_bytes(path, np.ascontiguousarray(points, "<f4").tobytes())
