"""Converts arrays of points of any common form to rows of finite float32; draws N points."""

from typing import Any

import numpy as np

from common.errors import InputError

MAX_RANGE = 1000.0
"""Metres along an axis; points beyond it are measurement errors."""
_INTENSITY = ("intensity", "i", "reflectance", "reflectivity", "scalar_intensity", "remission")
_TRANSPOSED = 12  # columns; an array of fewer rows than columns holds a point per column from here


def as_points(array: Any) -> tuple[np.ndarray, int]:
    """(n, 3 or 4) float32 x, y, z (metres) and intensity, and the number of points dropped.

    Args:
        array: (n, >= 3), an organised cloud (H, W, >= 3), a structured array of any shape or a data
            frame with fields x, y, z and perhaps intensity; [] holds no point.

    A point without a return (NaN or infinity in x, y or z) and one beyond `MAX_RANGE` are dropped;
    masked values count as NaN. The intensity is not used and may be NaN.

    Raises:
        InputError: another shape or type, no finite point, or more than half beyond `MAX_RANGE`.
    """
    if hasattr(array, "to_records") and {"x", "y", "z"} <= {str(c).lower() for c in array.columns}:
        array = array.to_records(index=False)  # a data frame, by the names of its columns
    try:
        array = np.asanyarray(array)
    except ValueError as error:
        raise InputError(f"expected an array of points: {error}") from error
    if array.dtype.names is not None:
        array = from_fields(array)
    elif isinstance(array, np.ma.MaskedArray):
        array = array.astype(np.float64).filled(np.nan)
    if array.dtype.kind not in "fiu":
        raise InputError(f"expected points of real numbers, found dtype {array.dtype}")
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
    return _returns(array[:, :4])


def _returns(points: np.ndarray) -> tuple[np.ndarray, int]:
    with np.errstate(invalid="ignore"):
        inside = np.abs(points[:, :3]) <= MAX_RANGE
    near = inside.all(axis=1) if not inside.all() else np.ones(len(points), bool)
    finite = near | np.isfinite(points[:, :3]).all(axis=1)
    if len(points) and not finite.any():
        raise InputError(f"expected finite points, found none among {len(points)}")
    far = int(finite.sum() - near.sum())
    if far > near.sum():
        raise InputError(
            f"expected metres, found {far} of {len(points)} points beyond {MAX_RANGE:.0f} m "
            "(--scan_scale reads files in other units)"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # an intensity may be any number
        return points[near].astype(np.float32), len(points) - int(near.sum())


def from_fields(array: np.ndarray) -> np.ndarray:
    """A structured array of any shape -> (n, 3 or 4) float64 x, y, z and intensity.

    Raises:
        InputError: it has no fields x, y, z of one real number each.
    """
    by_name = {name.lower(): name for name in reversed(array.dtype.names)}
    wanted = [by_name.get(axis) for axis in "xyz"]
    wanted += [by_name[name] for name in _INTENSITY if name in by_name][:1]
    if None in wanted or any(array.dtype[name].kind not in "fiu" for name in wanted):
        found = ", ".join(array.dtype.names)
        raise InputError(f"expected fields x, y, z (and intensity) of numbers, found {found}")
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
