"""The displacement experiment (paper, section IV.D, figure 5 and table V).

Every object of every frame is shifted by a random vector in the ground plane, up to D metres, and
its points with it. The paper leaves the distribution open; the readings offered here are

- `uniform`: length uniform in [0, D], direction uniform;
- `per_axis`: x and y each uniform in [-D, D];
- both either drawn afresh in each frame, or (`hold`) once per object and kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kitti.boxes import IMAGE_SIZE, observation_angle, points_in_boxes, project_boxes
from kitti.calibration import Calibration
from kitti.iou import iou_bev_pairs
from kitti.objects import Objects

LENGTHS = ("uniform", "per_axis")
DEFAULT_READING = ("uniform", False)
"""(length, hold) unless another reading is asked for."""

_HELD = -1  # stands for the frame number where the shift is held


@dataclass(frozen=True)
class DisplacementModel:
    """How far objects are shifted.

    Attributes:
        distance: D in metres, >= 0.
        seed: any integer >= 0; another one gives other shifts.
        length: "uniform" or "per_axis" (module docstring).
        hold: one shift per object instead of one per object and frame.
    """

    distance: float
    seed: int = 0
    length: str = DEFAULT_READING[0]
    hold: bool = DEFAULT_READING[1]

    def __post_init__(self):
        if not (np.isfinite(self.distance) and self.distance >= 0):
            raise ValueError(f"distance: expected metres >= 0, found {self.distance}")
        if not 0 <= self.seed < 2**63:
            raise ValueError(f"seed: expected 0 <= seed < 2**63, found {self.seed}")
        if self.length not in LENGTHS:
            raise ValueError(f"length: expected one of {LENGTHS}, found {self.length!r}")

    def offsets(self, objects: Objects, seq: int) -> np.ndarray:
        """Shifts (R, 2) float64, metres along level x and y, one per row of `objects`.

        They depend on (seed, seq, frame, track id) alone, not on the order of rows nor on which
        other rows there are. Rows without an id or a box (DontCare) get 0.
        """
        frame = np.full(len(objects), _HELD) if self.hold else objects.frame
        u, v = _uniform(self.seed, seq, frame, objects.track_id)
        if self.length == "uniform":
            reach, angle = self.distance * u, 2 * np.pi * v
            shift = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
        else:
            shift = self.distance * (2 * np.stack([u, v], axis=1) - 1)
        fixed = (objects.track_id < 0) | np.isnan(objects.boxes).any(axis=1)
        shift[fixed] = 0.0
        return shift


def _uniform(seed: int, seq: int, frame: np.ndarray, track_id: np.ndarray) -> np.ndarray:
    """(2, R) uniform numbers in [0, 1): two hashes of each key."""
    key = _mix(np.array([seed], np.uint64))
    for part in (seq, frame, track_id):
        key = _mix(key ^ np.asarray(part, np.int64).astype(np.uint64))
    both = np.stack([_mix(key ^ np.uint64(1)), _mix(key ^ np.uint64(2))])
    return (both >> np.uint64(11)).astype(np.float64) / 2**53


def _mix(value: np.ndarray) -> np.ndarray:
    """SplitMix64's step and finalizer (Steele, Lea, Flood, OOPSLA 2014) on uint64."""
    value = value + np.uint64(0x9E3779B97F4A7C15)  # wraps around, as it should
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


def displace_objects(
    objects: Objects,
    offsets: np.ndarray,
    calib: Calibration | None = None,
    image_size: tuple[int, int] = IMAGE_SIZE,
) -> Objects:
    """Moves each row's box by its offset (R, 2).

    With `calib`, the rows that moved also get the alpha and the projected 2-D box of their new
    place (-1 -1 -1 -1 outside the image); without, those stay as they are.
    """
    boxes = objects.boxes.copy()
    boxes[:, :2] += offsets
    if calib is None:
        return objects.with_boxes(boxes)
    alpha, bbox = objects.alpha.copy(), objects.bbox.copy()
    rows = np.flatnonzero((np.asarray(offsets) != 0).any(axis=1) & ~np.isnan(boxes).any(axis=1))
    alpha[rows] = observation_angle(boxes[rows])
    bbox[rows] = np.nan_to_num(project_boxes(boxes[rows], calib, image_size), nan=-1.0)
    return replace(objects, boxes=boxes, alpha=alpha, bbox=bbox)


def displace_points(points: np.ndarray, boxes: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Moves the points inside each box by the box's offset.

    Args:
        points: (n, >= 3) level frame; further columns are kept.
        boxes: (M, 7) boxes before they are moved; a point in several goes with the first.
        offsets: (M, 2) metres.

    Returns:
        A new array like `points`, float32.
    """
    moved = np.array(points, np.float32)
    index = points_in_boxes(points, boxes)
    inside = np.flatnonzero(index >= 0)
    moved[inside, :2] += np.asarray(offsets)[index[inside]].astype(np.float32)
    return moved


def displace_detections(
    detections: Objects,
    objects: Objects,
    offsets: np.ndarray,
    calib: Calibration | None = None,
    image_size: tuple[int, int] = IMAGE_SIZE,
) -> Objects:
    """Moves each detection with the object it overlaps most (largest BEV IoU above 0).

    Args:
        detections: (P rows) of the same sequence.
        objects: (R rows) where they are before they are moved.
        offsets: (R, 2) of the objects.
        calib, image_size: as in `displace_objects`.
    """
    carried = np.zeros((len(detections), 2))
    row, partner = _pairs_in_frame(detections.frame, objects.frame)
    overlap = iou_bev_pairs(detections.boxes[row], objects.boxes[partner])
    order = np.argsort(overlap, kind="stable")
    order = order[overlap[order] > 0]
    carried[row[order]] = np.asarray(offsets)[partner[order]]  # the largest is written last
    return displace_objects(detections, carried, calib, image_size)


def _pairs_in_frame(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (i, j) of all pairs with a[i] == b[j]."""
    order = np.argsort(b, kind="stable")
    first, last = (np.searchsorted(b[order], a, side=side) for side in ("left", "right"))
    count = last - first
    i = np.repeat(np.arange(len(a)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return i, order[np.repeat(first, count) + within]
