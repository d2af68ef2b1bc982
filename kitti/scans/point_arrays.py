"""Converts arrays of points of any common form to rows of finite float32; draws N points."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import InputError

MAX_RANGE = 1000.0
"""Metres along an axis; points beyond it are measurement errors."""
MAX_MEDIAN = 300.0
"""Metres, of the ranges of a scan; KITTI's median is 9."""
_INTENSITY = ("intensity", "i", "reflectance", "reflectivity", "scalar_intensity", "remission")
_FEW = 20  # points
_SHOWN = 12  # names in a message
_TRANSPOSED = 12  # columns; an array of fewer rows than columns holds a point per column from here


def as_points(array: Any) -> tuple[np.ndarray, int]:
    """(n, 3 or 4) float32 x, y, z (metres) and intensity, and the number of points dropped.

    Args:
        array: (n, >= 3), an organised cloud (H, W, >= 3), or a structured array of any shape, a
            data frame or a dictionary of columns with the names x, y, z and perhaps intensity in
            any case; [] holds no point.

    A point without a return (NaN or infinity in x, y or z) and one beyond `MAX_RANGE` are dropped;
    masked values count as NaN. The intensity is not used and may be NaN.

    Raises:
        InputError: another shape or type, no finite point, more than half beyond `MAX_RANGE`, or a
            median beyond `MAX_MEDIAN`.
    """
    given, names = array, _column_names(array)
    if names is not None:
        array = _from_columns(array, names)
    try:
        array = np.asanyarray(array)
    except Exception as error:  # libraries of arrays raise many types
        raise InputError(f"expected an array of points: {error}") from error
    if array.dtype.names is not None:
        array = from_fields(array)
    elif isinstance(array, np.ma.MaskedArray):
        array = array.astype(np.float64).filled(np.nan)
    if array.dtype.kind not in "fiu" or array.dtype.itemsize == 1:  # of 8 bits are images
        raise InputError(f"expected points of real numbers, found {_kind(given, array)}")
    shape, array = array.shape, np.asarray(array)
    if shape == (0,):
        array = array.reshape(0, 3)
    if len(shape) in (2, 3) and shape[0] < shape[-1] > _TRANSPOSED:
        expected = "(n, >=3) or (H, W, >=3)"
        raise InputError(f"expected points of shape {expected}, found {shape}: transpose it")
    if array.ndim == 3:
        array = array.reshape(-1, shape[2])
    if array.ndim != 2 or array.shape[1] < 3:
        raise InputError(f"expected points of shape (n, >=3) or (H, W, >=3), found {shape}")
    _refuse_batch_index(array)
    return _returns(array[:, :4])


def _refuse_batch_index(array: np.ndarray) -> None:
    """Refuses (n, >= 5) points behind a column of equal numbers, as networks' batches have it."""
    if len(array) < _FEW or array.shape[1] < 5 or np.ptp(array[:, 0]) != 0:
        return
    if (np.ptp(array[:, 1:4], axis=0) != 0).all():
        expected = "expected columns x, y, z, ..."
        raise InputError(
            f"{expected}, found {array[0, 0]:g} in all of column 1: is it a batch index?"
        )


def _column_names(table: Any) -> list[Any] | None:
    """Names of the columns of a data frame (pandas, Polars, Arrow) or a dictionary; else None.

    A frame without names, whose columns are numbered from 0, is read by their places: None.
    """
    found = table.keys() if isinstance(table, Mapping) else None
    for attribute in ("column_names", "columns"):
        found = getattr(table, attribute, None) if found is None else found
    if found is None or isinstance(table, np.ndarray):
        return None
    names = list(found)
    return None if names == list(range(len(names))) else names


def _from_columns(table: Any, names: list[Any]) -> np.ndarray:
    """(n, 3 or 4) x, y, z and intensity of a data frame or a dictionary of columns."""
    wanted = _point_names(names, "columns")
    try:
        columns = [np.asarray(table[name]) for name in wanted]
        if any(column.dtype.kind not in "fiu" for column in columns):
            columns = [column.astype(np.float64) for column in columns]  # Python's numbers
        return np.stack([column.reshape(-1) for column in columns], axis=1)
    except Exception as error:  # libraries of tables raise many types
        found = ", ".join(map(str, wanted))
        raise InputError(f"expected columns of numbers, found {found}: {error}") from error


def _point_names(names: Sequence[Any], kind: str) -> list[Any]:
    """The names of x, y, z and, where there is one, the intensity, in any case.

    Raises:
        InputError: there is no x, y or z; `kind` names them in the message.
    """
    by_name = {str(name).strip().lower(): name for name in reversed(names)}
    wanted = [by_name[axis] for axis in "xyz" if axis in by_name]
    if len(wanted) < 3:
        found = ", ".join(map(str, names[:_SHOWN])) + ", ..." * (len(names) > _SHOWN)
        raise InputError(
            f"expected {kind} x, y, z (and intensity) of numbers, found {found or 'none'}"
        )
    return wanted + [by_name[name] for name in _INTENSITY if name in by_name][:1]


def _kind(given: Any, array: np.ndarray) -> str:
    """The type of an array of no numbers, and the way to points where it is known."""
    if isinstance(given, str | Path):
        return f"a path: kitti.scans.scan_files.read_scan({str(given)[:80]!r}) reads a file"
    if array.dtype.hasobject and not isinstance(given, np.ndarray | list | tuple):
        return f"{type(given).__name__}, which is no array"
    return f"dtype {array.dtype}"


def _returns(points: np.ndarray) -> tuple[np.ndarray, int]:
    with np.errstate(invalid="ignore"):
        xyz = points[:, :3]
        inside = (xyz >= -MAX_RANGE) & (xyz <= MAX_RANGE)  # the smallest integer has no magnitude
    near = inside.all(axis=1) if not inside.all() else np.ones(len(points), bool)
    finite = near | np.isfinite(points[:, :3]).all(axis=1)
    if len(points) and not finite.any():
        raise InputError(f"expected finite points, found none among {len(points)}")
    far = int(finite.sum() - near.sum())
    if far > near.sum():
        raise InputError(
            f"expected metres, found {far} of {len(points)} points beyond {MAX_RANGE:.0f} m "
            "(--scan_scale reads files in other units; the scanner is the origin)"
        )
    if near.sum() > _FEW:
        middle = np.median(np.linalg.norm(points[near, :3].astype(np.float64), axis=1))
        if middle > MAX_MEDIAN:
            raise InputError(f"expected metres from the scanner, found a median of {middle:.4g}")
    with np.errstate(over="ignore", invalid="ignore"):  # an intensity may be any number
        return points[near].astype(np.float32), len(points) - int(near.sum())


def from_fields(array: np.ndarray) -> np.ndarray:
    """A structured array of any shape -> (n, 3 or 4) float64 x, y, z and intensity.

    Raises:
        InputError: it has no fields x, y, z of one real number each.
    """
    wanted = _point_names(array.dtype.names, "fields")
    for name in wanted:
        if array.dtype[name].kind not in "fiu":
            expected = "expected fields x, y, z (and intensity) of numbers"
            raise InputError(f"{expected}, found {name} of type {array.dtype[name]}")
    with np.errstate(invalid="ignore"):  # of signalling NaN
        return np.stack([array[name].ravel().astype(np.float64) for name in wanted], axis=1)


def sample_points(points: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (n,) int64 of `n` of the points, in random order.

    Without replacement where there are enough; otherwise every point once and the rest repeated
    at random.

    Raises:
        ValueError: there are no points.
    """
    count = len(points)
    if count == 0 and n > 0:
        raise ValueError(f"cannot draw {n} points from none")
    if count >= n:
        return rng.permutation(count)[:n]
    return rng.permutation(np.concatenate([np.arange(count), rng.integers(0, count, n - count)]))
