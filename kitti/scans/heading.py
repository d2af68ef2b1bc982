"""Tells from pairs of consecutive scans along which axis the scanner moves: a car's is x.

Letters: G cells along a side of a grid that is seen from above.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

CELL = 0.2
"""Metres."""
_HALF = 25.6  # metres to each side; farther, turns blur the scene
_REACH = 10.0  # metres between two scans: 20 m/s at 2 Hz
_HEIGHT = 0.5  # metres above the lowest points; the road looks alike everywhere
_FEW = 1000  # points; fewer do not determine a scene
_LEAST_FIT = 0.55  # share of the cells that coincide; in KITTI 0.65 at 10 Hz, less after turns
_CLEARLY = 1.05  # times better than along the other axis; KITTI's y by 1.01 at most, x by 1.2


class Motion(NamedTuple):
    """Best fits of two scans, moved along one axis of the horizontal plane or the other.

    The fits are shares of occupied cells that coincide, the distances metres by which the
    surroundings come closer.
    """

    along_x: float
    along_y: float
    dx: float
    dy: float


def find_motion(before: np.ndarray, after: np.ndarray) -> Motion | None:
    """The motion between two (n, >= 3) scans (metres, z up); None where they do not tell.

    They do not if they are small, or fit nowhere.
    """
    if min(len(before), len(after)) < _FEW:
        return None
    fit = _correlation(_seen_from_above(before), _seen_from_above(after))
    zero = len(fit) // 2
    near = slice(zero - 1, zero + 2)  # the other axis may differ by a cell
    along_x, along_y = fit[:, near].max(axis=1), fit[near].max(axis=0)
    if fit.max() < _LEAST_FIT:
        return None
    dx, dy = ((int(fits.argmax()) - zero) * CELL for fits in (along_x, along_y))
    return Motion(float(along_x.max()), float(along_y.max()), dx, dy)


def _seen_from_above(points: np.ndarray) -> np.ndarray:
    """(G, G) grid of what stands on the road, cells beside an occupied one included."""
    standing = points[points[:, 2] > np.percentile(points[:, 2], 5) + _HEIGHT]
    edges = np.arange(-_HALF, _HALF + CELL / 2, CELL)
    occupied = np.histogram2d(standing[:, 0], standing[:, 1], (edges, edges))[0] > 0
    beside = (np.roll(occupied, step, axis) for step in (1, -1) for axis in (0, 1))
    return sum(beside, occupied.astype(float))


def _correlation(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Share of two grids that coincides when `after` is moved by up to `_REACH` each way."""
    spectrum = np.fft.rfft2(before) * np.conj(np.fft.rfft2(after))
    product = np.fft.fftshift(np.fft.irfft2(spectrum, before.shape))
    zero, reach = len(product) // 2, round(_REACH / CELL)
    window = slice(zero - reach, zero + reach + 1)
    size = np.sqrt((before**2).sum() * (after**2).sum())
    return product[window, window] / max(size, 1.0)


def axis_ahead(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> str | None:
    """The axis (x, -x, y, -y) along which a car drives, from pairs of consecutive (n, >= 3) scans.

    None where it is not known: both axes fit alike where it stands still.
    """
    found = [motion for motion in (find_motion(*pair) for pair in pairs) if motion is not None]
    along_x, along_y, dx, dy = np.sum([*found, Motion(0, 0, 0, 0)], axis=0)
    if along_y > _CLEARLY * along_x:
        return "y" if dy > 0 else "-y"
    if along_x > _CLEARLY * along_y:
        return "x" if dx > 0 else "-x"
    return None
