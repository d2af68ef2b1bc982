"""Overlap of boxes: in 3-D, seen from above, and in the image (x1, y1, x2, y2 in pixels).

Shapely computes the areas of rotated boxes, for pairs that may overlap.
"""

import numpy as np
import shapely

from kitti.boxes import box_corners

_GRID_M = 1e-10  # far below any label's precision, far above float64's rounding at 100 m
EPS = np.finfo(np.float64).eps
_TOUCH_M2 = 1e-9  # at most this much of touching boxes overlaps by the grid


def iou_3d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union of volumes: (M, 7), (K, 7) -> (M, K) float64 in [0, 1].

    Boxes with NaN overlap nothing.
    """
    a, b = _boxes(a), _boxes(b)
    iou = np.zeros((len(a), len(b)))
    rows, columns = np.nonzero(_near(a[:, None], b[None]))
    iou[rows, columns] = iou_3d_pairs(a[rows], b[columns])
    return iou


def giou_3d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Generalised IoU (Rezatofighi et al., CVPR 2019): (M, 7), (K, 7) -> (M, K) in (-1, 1].

    The enclosing body is the convex hull seen from above times the joint height, as in AB3DMOT.
    Boxes with NaN give -1.
    """
    a, b = _boxes(a), _boxes(b)
    rows, columns = np.indices((len(a), len(b))).reshape(2, -1)
    return giou_3d_pairs(a[rows], b[columns]).reshape(len(a), len(b))


def iou_3d_pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row IoU of volumes: (P, 7), (P, 7) -> (P,) float64."""
    a, b = _boxes(a), _boxes(b)
    common = np.zeros(len(a))
    some = np.flatnonzero(_near(a, b) & (_shared_height(a, b) > 0))
    common[some] = _shared_area(a[some], b[some]) * _shared_height(a[some], b[some])
    return _ratio(common, a[:, 3:6].prod(axis=1) + b[:, 3:6].prod(axis=1) - common)


def iou_bev_pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row IoU seen from above: (P, 7), (P, 7) -> (P,) float64."""
    a, b = _boxes(a), _boxes(b)
    common = np.zeros(len(a))
    some = np.flatnonzero(_near(a, b))
    common[some] = _shared_area(a[some], b[some])
    return _ratio(common, a[:, 3] * a[:, 4] + b[:, 3] * b[:, 4] - common)


def giou_3d_pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row generalised IoU: (P, 7), (P, 7) -> (P,) float64."""
    a, b = _boxes(a), _boxes(b)
    giou = np.full(len(a), -1.0)
    good = np.flatnonzero(np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1))
    a, b = a[good], b[good]
    iou = iou_3d_pairs(a, b)
    union = (a[:, 3:6].prod(axis=1) + b[:, 3:6].prod(axis=1)) / (1 + iou)
    centre = a[:, :3]
    corners = np.concatenate([_footprint(a, centre), _footprint(b, centre)], axis=1)  # (P, 8, 2)
    area = shapely.area(shapely.convex_hull(shapely.multipoints(corners)))
    top = np.maximum(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = np.minimum(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    giou[good] = iou - 1 + _ratio(union, area * (top - bottom))
    return giou


def _boxes(boxes: np.ndarray) -> np.ndarray:
    return np.asarray(boxes, np.float64).reshape(-1, 7)


def _near(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True where the circles around both boxes, seen from above, meet; False with NaN."""
    reach = np.hypot(a[..., 3], a[..., 4]) + np.hypot(b[..., 3], b[..., 4])
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]) * 2 < reach


def _shared_height(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    top = np.minimum(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = np.maximum(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    return np.maximum(top - bottom, 0.0)


def _footprint(boxes: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(P, 4, 2) corners seen from above, relative to `centre` (P, >= 2), for precision."""
    boxes = boxes.copy()
    boxes[:, :2] -= centre[:, :2]
    return box_corners(boxes)[:, :4, :2]


def _shared_area(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Area (P,) that both footprints cover, in square metres.

    GEOS 3.14.1 finds no intersection for up to one in 100 pairs whose edges are collinear up to
    rounding, but finds it with coordinates snapped to a fine grid. Pairs without an intersection
    are therefore computed again on the grid.
    """
    if not len(a):
        return np.zeros(0)
    of_a, of_b = (shapely.polygons(_footprint(boxes, a)) for boxes in (a, b))
    area = shapely.area(shapely.intersection(of_a, of_b))
    none = np.flatnonzero(area == 0)
    again = shapely.area(shapely.intersection(of_a[none], of_b[none], grid_size=_GRID_M))
    area[none] = np.where(again > _TOUCH_M2, again, 0.0)
    return area


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """part / whole, at most 1; 0 where whole is not above 0."""
    good = whole > 0
    return np.where(good, np.minimum(part / np.where(good, whole, 1.0), 1.0), 0.0)


def footprints_overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """True where boxes seen from above share an area, by the separating axis theorem.

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


def _intersection(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Areas shared by image boxes (M, 4) and (K, 4): (M, K) square pixels."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    return np.prod(np.maximum(high - low, 0.0), axis=-1)


def _area(boxes: np.ndarray) -> np.ndarray:
    """Areas (M,) of image boxes (M, 4), square pixels."""
    return (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])


def iou_2d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union (M, K) of image boxes; 0 where either box is empty."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    shared, area_a, area_b = _intersection(a, b), _area(a), _area(b)
    union = area_a[:, None] + area_b[None, :] - shared
    valid = (area_a > EPS)[:, None] & (area_b > EPS)[None, :] & (union > EPS)
    return np.where(valid, shared, 0.0) / np.where(valid, union, 1.0)


def covered(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Share (M, K) of the area of image boxes `a` that lies in each of `b`; 0 for an empty one."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    area_a = _area(a)[:, None]
    return np.where(area_a > EPS, _intersection(a, b), 0.0) / np.where(area_a > EPS, area_a, 1.0)


def iou_2d_pairs(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row IoU of image boxes: (P, 4), (P, 4) -> (P,) float64; 0 for boxes with NaN."""
    sides = np.minimum(a[:, 2:], b[:, 2:]) - np.maximum(a[:, :2], b[:, :2])
    common = np.clip(sides, 0, None).prod(axis=1)
    return np.nan_to_num(_ratio(common, _area(a) + _area(b) - common))
