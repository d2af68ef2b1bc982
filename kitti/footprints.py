"""Overlap of boxes seen from above, by the separating axis theorem: fast, no areas."""

from __future__ import annotations

import numpy as np


def footprints_overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the turned rectangles of boxes share an area seen from above.

    Args:
        a, b: (..., 7) boxes of one frame, which broadcast against each other.

    Returns:
        (...) bool; False where they only touch, and for boxes with NaN.
    """
    x, y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    turn = b[..., 6] - a[..., 6]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    length_a, width_a, length_b, width_b = a[..., 3], a[..., 4], b[..., 3], b[..., 4]
    along_b = (length_b * cos + width_b * sin, length_b * sin + width_b * cos)
    along_a = (length_a * cos + width_a * sin, length_a * sin + width_a * cos)
    common = True
    for yaw, own, other in (
        (a[..., 6], (length_a, width_a), along_b),
        (b[..., 6], (length_b, width_b), along_a),
    ):
        c, s = np.cos(yaw), np.sin(yaw)
        common = common & (2 * np.abs(c * x + s * y) < own[0] + other[0])
        common = common & (2 * np.abs(c * y - s * x) < own[1] + other[1])
    return common
