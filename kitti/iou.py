"""Overlap of upright boxes that are turned about z: shapely, only over pairs that can overlap."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from kitti.boxes import box_corners

_GRID_M = 1e-10  # far below any label's precision, far above float64's rounding at 100 m
_TOUCH_M2 = 1e-9  # boxes that touch share at most a sliver that comes from the grid


def iou_3d(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union of volumes: (M, 7), (K, 7) -> (M, K) float64 in [0, 1].

    Boxes with NaN overlap nothing.
    """
    return _matrix(a, b, iou_3d_pairs)


def iou_bev(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union seen from above: (M, 7), (K, 7) -> (M, K) float64 in [0, 1]."""
    return _matrix(a, b, iou_bev_pairs)


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


def _matrix(
    a: np.ndarray, b: np.ndarray, pairs: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """(M, K) values of `pairs`, computed only where the circles around both boxes meet."""
    a, b = _boxes(a), _boxes(b)
    values = np.zeros((len(a), len(b)))
    rows, columns = np.nonzero(_near(a[:, None], b[None]))
    values[rows, columns] = pairs(a[rows], b[columns])
    return values


def _near(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether the circles around both boxes, seen from above, meet; False with NaN."""
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

    GEOS (seen with 3.14.1) finds no intersection at all for up to one in 100 pairs whose edges lie
    on the same lines up to rounding. With coordinates snapped to a fine grid it does, so pairs
    without an intersection are asked again in that way.
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
    """part / whole, 0 where whole is not above 0; rounding can not bring it above 1."""
    good = whole > 0
    return np.where(good, np.minimum(part / np.where(good, whole, 1.0), 1.0), 0.0)
