"""View of the left colour camera: image size, points of a scan inside it, checks of the axes."""

import math
import operator
import re
from collections.abc import Iterable

import numpy as np

from common.errors import InputError
from common.notes import note
from kitti.boxes import IMAGE_SIZE
from kitti.calibration import MAX_PIXELS, Calibration

# KITTI was recorded on five days; rectification gave the images of each day one size, one focal
# length and one principal point (Geiger et al., IJRR 2013, raw data): f, cx, cy, width, height.
_KITTI_CAMERAS = (
    (721.5377, 609.5593, 172.8540, 1242, 375),  # 2011_09_26
    (707.0493, 604.0814, 180.5066, 1224, 370),  # 2011_09_28
    (718.3351, 600.3891, 181.5122, 1238, 374),  # 2011_09_29
    (707.0912, 601.8873, 183.1104, 1226, 370),  # 2011_09_30
    (718.8560, 607.1928, 185.2157, 1241, 376),  # 2011_10_03
)
_SAME = 5e-5  # of the principal point, in focal lengths: a thirtieth of a pixel of KITTI's
_NEAR = (25.0, 15.0, 15.0, 25.0)  # pixels: another camera of KITTI's kind, such as the simulator's
MIN_DEPTH = 0.1
"""Least depth of a visible point, metres in front of the left colour camera."""
LEAST_SHARE = 0.005
"""Least share of a scan's points in view; a full turn has 0.1 to 0.3 in KITTI's view."""
_EXPECTED = "expected x ahead, y left, z up in metres and the calibration of this scanner"
_FEW = 1000  # points; fewer do not determine a scene
_RANGE = (1.0, 120.0)  # metres, median of the ranges; KITTI's is 9, of the part in view 15
_HIGH = 0.7  # ratio of height to the wider horizontal side of a street scene; KITTI: below 0.2
_STEEP = 1.5  # the same to its narrower side; KITTI's is below 0.3
_FLAT = 0.3  # ratio of the spread of road heights to that of objects on it; KITTI: 0.1
_ROAD = (-3.0, -0.8)  # metres, usual height of the road in the level frame; KITTI's is -1.7
_NEAR_ROAD = 60.0  # metres ahead; farther, a slope counts
_BEHIND = -0.5  # metres, from the camera
_RADIANS = np.pi + 0.2  # with the offset between scanner and camera
_DEEP = 20.0  # metres between the nearest and the farthest point, more than a part of a scan has
_ASIDE = 3.0  # half a turn has a fifth of its points farther to the side than 3 times ahead
_SIDEWAYS = 1.8  # a road reaches farther ahead and behind than to its sides
_CENTRAL = 0.2  # of the width and height
GUESSED = "twice the principal point of P2"
"""Source of a size that no file, flag or camera of KITTI's kind determines."""
_SIZE = re.compile(r"(\d{1,5})x(\d{1,5})", re.ASCII)


def image_size_of(calib: Calibration, given: tuple[int, int] | None = None) -> tuple[int, int]:
    """Width and height in pixels; see `describe_image_size`."""
    return describe_image_size(calib, given)[0]


def describe_image_size(
    calib: Calibration, given: tuple[int, int] | None = None
) -> tuple[tuple[int, int], str]:
    """Width and height in pixels, and their source.

    Sources in order of priority: `S_rect_02` of the calibration; `given` (a flag); KITTI's size,
    scaled, where focal length and principal point are those of a KITTI camera at any resolution;
    KITTI's most frequent size where they are close to its own; twice the principal point.

    Raises:
        InputError: `given` is no size or contradicts the calibration, or there is no size: the
            principal point is not inside an image.
    """
    if given is not None:
        given = _checked_size(given)
    if calib.size is not None:
        if given is not None and given != calib.size:
            raise InputError(
                f"--image_size: the calibration says {_text(calib.size)}, found {_text(given)}"
            )
        _check_centre(calib, calib.size, "S_rect_02")
        return calib.size, "S_rect_02 of the calibration"
    if given is not None:
        _check_centre(calib, given, "--image_size")
        return given, "--image_size"
    focal, cx, cy, other = (float(calib.p2[i]) for i in ((0, 0), (0, 2), (1, 2), (1, 1)))
    for f, x, y, width, height in _KITTI_CAMERAS:
        if abs(cx / focal - x / f) < _SAME and abs(cy / other - y / f) < _SAME:
            scale = focal / f
            size = math.ceil(width * scale - 0.1), math.ceil(height * scale - 0.1)
            return size, "KITTI's camera"
    f, x, y, *_ = _KITTI_CAMERAS[0]
    if (np.abs(np.subtract((f, x, y, f), (focal, cx, cy, other))) < _NEAR).all():
        return IMAGE_SIZE, "near KITTI's camera"
    size = round(2 * cx), round(2 * cy)
    if min(size) < 1:
        raise InputError(
            f"the principal point ({cx:g}, {cy:g}) of P2 is in no image: expected S_rect_02 in the "
            "calibration, or --image_size WIDTHxHEIGHT of track.py or evaluate.py"
        )
    return size, GUESSED


def _check_centre(calib: Calibration, size: tuple[int, int], source: str) -> None:
    """Notes a principal point far from the centre of the image.

    Raises:
        InputError: it is outside, and inside where width and height change places.
    """
    centre = np.array([calib.p2[0, 2], calib.p2[1, 2]])
    place = f"the principal point ({centre[0]:g}, {centre[1]:g}) of P2"
    if (centre > size).any() and (centre < size[::-1]).all():
        raise InputError(f"{source}: {place} is outside {_text(size)}: expected WIDTHxHEIGHT")
    if (np.abs(centre / size - 0.5) > _CENTRAL).any():
        note(f"{source}: {place} is far from the centre of {_text(size)} pixels")


def parse_image_size(text: str) -> tuple[int, int]:
    """Reads `1242x375`.

    Raises:
        InputError: not of that form, or a side that no camera has.
    """
    match = _SIZE.fullmatch(text)
    sides = (0, 0) if match is None else (int(match[1]), int(match[2]))
    if not all(1 <= side <= MAX_PIXELS for side in sides):
        raise InputError(f"--image_size: expected pixels such as 1242x375, found {text!r}")
    return sides


def _checked_size(given: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = (operator.index(side) for side in given)
    except (TypeError, ValueError):
        width = height = 0
    if not all(1 <= side <= MAX_PIXELS for side in (width, height)):
        expected = f"expected width and height from 1 to {MAX_PIXELS} pixels"
        raise InputError(f"image_size: {expected}, found {given!r}")
    return width, height


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def in_camera_view(
    points_level: np.ndarray,
    calib: Calibration,
    image_size: tuple[int, int] = IMAGE_SIZE,
) -> np.ndarray:
    """(n,) bool: the points (n, >= 3, level frame) inside the left colour image."""
    uv, depth = calib.project_level(points_level[:, :3])
    width, height = image_size
    seen = depth > MIN_DEPTH
    seen &= (uv[:, 0] >= 0) & (uv[:, 0] < width)
    seen &= (uv[:, 1] >= 0) & (uv[:, 1] < height)
    return seen


def check_view(
    scans: Iterable[np.ndarray], calib: Calibration, image_size: tuple[int, int]
) -> tuple[int, int]:
    """Numbers of points in the camera's view and in all; scans (n, >= 3), Velodyne frame, metres.

    Raises:
        InputError: there is no point or no return, almost none is in the view, or the points are
            no street scene in metres with z up: another median range, as high as wide, polar
            coordinates, or the flat side above the camera.
    """
    seen = total = read = 0
    for points in scans:
        returned = (points[:, :3] != 0).any(axis=1)  # some scanners give 0 0 0 for no return
        level = calib.velo_to_level(points[returned, :3])
        inside = in_camera_view(level, calib, image_size)
        _check_axes(level, level[inside])
        seen, total, read = seen + int(inside.sum()), total + len(level), read + len(points)
    if total == 0:
        found = f"all of {read} points lie at the origin" if read else "the scans have no points"
        raise InputError(f"{found}, so there is no return")
    if seen < LEAST_SHARE * total:
        raise InputError(
            f"{seen} of {total} points lie in the camera's view ({image_size[0]} x "
            f"{image_size[1]} pixels), so nothing can be found: {_EXPECTED}"
        )
    return seen, total


def spreads_sideways(level: np.ndarray) -> bool:
    """True where (n, 3) points of a full turn reach farther to the sides than along the road."""
    if len(level) < _FEW:
        return False
    low, high = np.percentile(level, (5, 95), axis=0)
    x, y, _ = high - low
    return low[0] < -1 and y > _SIDEWAYS * x


def _is_polar(level: np.ndarray) -> bool:
    """True where (n, 3) numbers look like range, azimuth and elevation, in radians or degrees."""
    x, y, z = level.T
    if x.min() < _BEHIND:
        return False  # a range is positive
    radians = np.abs(y).max() < _RADIANS and np.abs(z).max() < _RADIANS / 2 and np.ptp(x) > _DEEP
    return bool(radians or (np.abs(y) > _ASIDE * x).mean() > 0.5)


def _check_axes(level: np.ndarray, inside: np.ndarray) -> None:
    """Refuses (n, 3) points that are not a street scene with z up; notes unlikely properties.

    `level` are the points of a scan in the level frame (metres), `inside` those in view.
    """
    if len(level) < _FEW:
        return
    middle = np.median(np.linalg.norm(level, axis=1))
    if not _RANGE[0] < middle < _RANGE[1]:
        raise InputError(f"a median range of {middle:.3g} m: {_EXPECTED}")
    low, high = np.percentile(level, (5, 95), axis=0)
    x, y, z = high - low
    if z > _HIGH * max(x, y) or z > _STEEP * min(x, y):
        spread = f"{x:.1f} m ahead, {y:.1f} m to the sides and {z:.1f} m upwards"
        raise InputError(f"the points spread {spread}: {_EXPECTED}")
    if _is_polar(level):
        raise InputError(f"the points look like range, azimuth, elevation: {_EXPECTED}")
    near = inside[inside[:, 0] < _NEAR_ROAD]
    if len(near) < _FEW:
        return
    z5, z30, z70, z95 = np.percentile(near[:, 2], (5, 30, 70, 95))
    if z95 - z70 < _FLAT * (z30 - z5) and z70 > 0:
        raise InputError(f"the flat side of the scene is above the camera: {_EXPECTED}")
    if z30 - z5 < _FLAT * (z95 - z70) and not _ROAD[0] < z5 < _ROAD[1]:
        note(
            f"the road seems to lie {-z5:.1f} m below the camera, in training it was 1.7 m: check "
            "the unit (--scan_scale of track.py) and the calibration"
        )
