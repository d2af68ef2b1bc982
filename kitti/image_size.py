"""Size of the left colour image: from the calibration, a flag, or the camera's principal point."""

from __future__ import annotations

import math
import re

import numpy as np

from common.errors import InputError
from kitti.boxes import IMAGE_SIZE
from kitti.calibration import Calibration

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
_NEAR = (25.0, 15.0, 15.0)  # pixels: another camera of KITTI's kind, such as the simulator's
_SIZE = re.compile(r"(\d{1,5})x(\d{1,5})", re.ASCII)


def image_size_of(calib: Calibration, given: tuple[int, int] | None = None) -> tuple[int, int]:
    """Width and height in pixels; see `describe_image_size`."""
    return describe_image_size(calib, given)[0]


def describe_image_size(
    calib: Calibration, given: tuple[int, int] | None = None
) -> tuple[tuple[int, int], str]:
    """Width and height in pixels, and where they are known from.

    In this order: the calibration's own (`S_rect_02`); `given` (a flag); KITTI's size, scaled,
    where focal length and principal point are those of a KITTI camera at any resolution; KITTI's
    most frequent size where they are near to its own; twice the principal point.

    Raises:
        InputError: `given` contradicts the calibration, or there is no size: the principal point
            is not inside an image.
    """
    if calib.size is not None:
        if given is not None and given != calib.size:
            raise InputError(
                f"--image_size: the calibration says {_text(calib.size)}, found {_text(given)}"
            )
        return calib.size, "S_rect_02 of the calibration"
    if given is not None:
        return given, "--image_size"
    focal, cx, cy = calib.p2[0, 0], calib.p2[0, 2], calib.p2[1, 2]
    for f, x, y, width, height in _KITTI_CAMERAS:
        if abs(cx / focal - x / f) < _SAME and abs(cy / calib.p2[1, 1] - y / f) < _SAME:
            scale = focal / f
            size = math.ceil(width * scale - 0.1), math.ceil(height * scale - 0.1)
            return size, "KITTI's camera"
    first = np.array(_KITTI_CAMERAS[0])
    if (np.abs(first[:3] - (focal, cx, cy)) < _NEAR).all():
        return IMAGE_SIZE, "near KITTI's camera"
    size = round(2 * cx), round(2 * cy)
    if min(size) < 1:
        raise InputError(
            f"the principal point ({cx:g}, {cy:g}) of P2 is in no image: give --image_size "
            "WIDTHxHEIGHT or S_rect_02 in the calibration"
        )
    return size, "twice the principal point of P2"


def parse_image_size(text: str) -> tuple[int, int]:
    """Reads `1242x375`.

    Raises:
        InputError: not of that form, or a side of 0.
    """
    match = _SIZE.fullmatch(text)
    if match is None or not int(match[1]) or not int(match[2]):
        raise InputError(f"--image_size: expected pixels such as 1242x375, found {text!r}")
    return int(match[1]), int(match[2])


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
