"""Boxes of the level frame: conversion from and to KITTI's, corners, points inside, projection."""

import numpy as np

from kitti.calibration import Calibration

IMAGE_SIZE = (1242, 375)
"""Width and height in pixels of most KITTI tracking sequences' left colour images."""
NEAR_DEPTH = 0.1  # metres; a box is cut at this depth before it is projected

# Corner i of a box is its centre + _CORNERS[i] * (l, w, h) / 2, rotated: the lower face
# counter-clockwise seen from above, starting front left, then the upper face.
_CORNERS = np.array(
    [[x, y, z] for z in (-1, 1) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))], np.float64
)
_EDGES = np.array(
    [(i, (i + 1) % 4) for i in range(4)]
    + [(4 + i, 4 + (i + 1) % 4) for i in range(4)]
    + [(i, i + 4) for i in range(4)]
)


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Wraps angles in radians to [-pi, pi)."""
    wrapped = np.mod(np.asarray(angle) + np.pi, 2 * np.pi) - np.pi
    # mod of a tiny negative number rounds up to 2 pi itself, which is not below pi.
    return np.where(wrapped >= np.pi, -np.pi, wrapped)[()]


def level_from_camera(*camera: np.ndarray) -> np.ndarray:
    """KITTI's h, w, l, x, y, z, ry (each (M,); camera frame, bottom centre) -> (M, 7) float64."""
    h, w, length, x, y, z, ry = (np.asarray(value, np.float64) for value in camera)
    return np.stack([z, -x, -y + h / 2, length, w, h, wrap_angle(-ry - np.pi / 2)], axis=-1)


def camera_from_level(boxes: np.ndarray) -> tuple[np.ndarray, ...]:
    """(M, 7) level boxes -> KITTI's h, w, l, x, y, z, ry, each (M,) float64, ry in [-pi, pi)."""
    x, y, z, length, w, h, yaw = np.moveaxis(np.asarray(boxes, np.float64), -1, 0)
    return h, w, length, -y, -z + h / 2, x, wrap_angle(-yaw - np.pi / 2)


def observation_angle(boxes: np.ndarray) -> np.ndarray:
    """KITTI's alpha (M,) in [-pi, pi) of (M, 7) level boxes: ry - atan2(x_cam, z_cam)."""
    _, _, _, x, _, z, ry = camera_from_level(boxes)
    return wrap_angle(ry - np.arctan2(x, z))


def box_corners(boxes: np.ndarray) -> np.ndarray:
    """(M, 7) boxes -> (M, 8, 3) float64 corners.

    The first four are the lower face, counter-clockwise seen from above, starting at the front
    left corner; the last four are the upper face in the same order.
    """
    boxes = np.asarray(boxes, np.float64).reshape(-1, 7)
    local = _CORNERS * (boxes[:, None, 3:6] / 2)
    cos, sin = np.cos(boxes[:, 6, None]), np.sin(boxes[:, 6, None])
    corners = np.empty_like(local)
    corners[..., 0] = cos * local[..., 0] - sin * local[..., 1]
    corners[..., 1] = sin * local[..., 0] + cos * local[..., 1]
    corners[..., 2] = local[..., 2]
    return corners + boxes[:, None, :3]


def points_in_boxes(points: np.ndarray, boxes: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """Index of the box that contains each point.

    Args:
        points: (n, >= 3), x y z first, in the boxes' frame.
        boxes: (M, 7); rows with NaN contain no point.
        margin: metres by which every face is moved outward (inward if negative).

    Returns:
        (n,) int32: index of the first box that contains the point (faces included), or -1.
    """
    boxes = np.asarray(boxes, np.float64).reshape(-1, 7)
    x, y, z = np.array(np.asarray(points)[:, :3].T, np.float64, order="C")
    index = np.full(len(x), -1, np.int32)
    half = boxes[:, 3:6] / 2 + margin
    radius = np.hypot(half[:, 0], half[:, 1]) + 1e-9  # room for rounding
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    usable = np.isfinite(boxes).all(axis=1) & (half >= 0).all(axis=1)
    for m in np.flatnonzero(usable)[::-1]:  # backwards, so that the first box wins
        near = np.flatnonzero(np.abs(x - boxes[m, 0]) <= radius[m])
        near = near[np.abs(y[near] - boxes[m, 1]) <= radius[m]]
        near = near[np.abs(z[near] - boxes[m, 2]) <= half[m, 2]]
        dx, dy = x[near] - boxes[m, 0], y[near] - boxes[m, 1]
        inside = np.abs(cos[m] * dx + sin[m] * dy) <= half[m, 0]
        inside &= np.abs(cos[m] * dy - sin[m] * dx) <= half[m, 1]
        index[near[inside]] = m
    return index


def count_points_in_boxes(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(M,) int: points (n, >= 3) in each box (M, 7); one in several counts in the first alone."""
    owner = points_in_boxes(points, boxes)
    return np.bincount(owner[owner >= 0], minlength=len(boxes))


def to_box_frame(xyz: np.ndarray, box: np.ndarray) -> np.ndarray:
    """(n, 3) points -> (n, 3) float64 from the centre of one box (7,), x along its length."""
    local = np.asarray(xyz, np.float64) - box[:3]
    cos, sin = np.cos(box[6]), np.sin(box[6])
    return local @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def transform_boxes(boxes: np.ndarray, transform: np.ndarray) -> np.ndarray:
    """(M, 7) boxes moved by a rigid (4, 4) transform -> (M, 7) float64.

    Boxes stay upright: the centre is transformed exactly; the new yaw is the heading of the
    transformed forward direction.
    """
    moved = np.array(boxes, np.float64).reshape(-1, 7)
    forward = np.stack([np.cos(moved[:, 6]), np.sin(moved[:, 6])], axis=1) @ transform[:2, :2].T
    moved[:, :3] = moved[:, :3] @ transform[:3, :3].T + transform[:3, 3]
    moved[:, 6] = wrap_angle(np.arctan2(forward[:, 1], forward[:, 0]))
    return moved


def project_boxes(
    boxes: np.ndarray, calib: Calibration, image_size: tuple[int, int] = IMAGE_SIZE
) -> np.ndarray:
    """2-D boxes (x1, y1, x2, y2) of (M, 7) level boxes in the left colour image.

    A box that reaches behind the camera is cut at `NEAR_DEPTH` first. The hull of the rest is
    clipped to pixel centres [0, width - 1] x [0, height - 1], as KITTI's labels are.

    Returns:
        (M, 4) float64 pixels; NaN for a box that is behind the camera or outside the image.
    """
    boxes = np.asarray(boxes, np.float64).reshape(-1, 7)
    corners = box_corners(boxes)
    homogeneous = corners @ calib.image_from_level[:, :3].T + calib.image_from_level[:, 3]
    start, end = homogeneous[:, _EDGES[:, 0]], homogeneous[:, _EDGES[:, 1]]  # (M, 12, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (NEAR_DEPTH - start[..., 2]) / (end[..., 2] - start[..., 2])
        cut = start + share[..., None] * (end - start)
        cut[~((share > 0) & (share < 1))] = np.nan
        visible = np.where(homogeneous[..., 2:] >= NEAR_DEPTH, homogeneous, np.nan)
        candidates = np.concatenate([visible, cut], axis=1)  # (M, 20, 3)
        uv = candidates[..., :2] / candidates[..., 2:]
    low = np.where(np.isnan(uv), np.inf, uv).min(axis=1, initial=np.inf)
    high = np.where(np.isnan(uv), -np.inf, uv).max(axis=1, initial=-np.inf)
    limit = np.array(image_size, np.float64) - 1
    clipped = np.concatenate([np.clip(low, 0, limit), np.clip(high, 0, limit)], axis=1)
    clipped[(clipped[:, 2:] <= clipped[:, :2]).any(axis=1)] = np.nan
    return clipped
