"""Random shifts of objects in the ground plane: the flags --object_shift and --displacement.

Every labelled object of every frame is shifted by a random vector in the ground plane, up to D
metres, and its points with it (section IV.D, Figure 5 and Table V of the paper). Training and
evaluation use the same shifts. The paper leaves the distribution open; the readings are

- `uniform`: length uniform in [0, D], direction uniform;
- `fixed`: length D, direction uniform;
- `per_axis`: x and y each uniform in [-D, D];
- `per_axis_positive`: x and y each uniform in [0, D];
- each either drawn afresh in each frame, or (`hold`) once per object and kept.

No shift makes two boxes overlap, seen from above, that did not overlap before: the objects of a
frame are moved in the order of their track ids, each by the first of `ATTEMPTS` draws that keeps
it clear of all others (those of larger ids still in their labelled places); an object without a
clear draw keeps its place. A held shift must be clear in every frame of its object.
"""

from dataclasses import dataclass, replace

import numpy as np

from common.errors import InputError
from kitti.boxes import points_in_boxes
from kitti.iou import footprints_overlap, iou_bev_pairs
from kitti.objects import Objects

LENGTHS = ("uniform", "fixed", "per_axis", "per_axis_positive")
DEFAULT_READING = ("uniform", False)
"""(length, hold) unless another reading is chosen."""
ATTEMPTS = 16
"""Draws of a shift before an object keeps its place."""

_HELD = -1  # the frame number in the key of a held shift

MAX_DISTANCE = 1000.0
"""Metres; the paper shifts objects by up to 2."""


@dataclass(frozen=True)
class ObjectShift:
    """Distribution and seed of the shifts.

    Attributes:
        distance: D in metres, 0 to `MAX_DISTANCE`.
        seed: any integer >= 0; another one gives other shifts.
        length: one of `LENGTHS` (module docstring).
        hold: one shift per object instead of one per object and frame.
    """

    distance: float
    seed: int = 0
    length: str = DEFAULT_READING[0]
    hold: bool = DEFAULT_READING[1]

    def __post_init__(self):
        if not 0 <= self.distance <= MAX_DISTANCE:
            expected = f"expected 0 to {MAX_DISTANCE:.0f} metres"
            raise InputError(f"--object_shift: {expected}, found {self.distance}")
        if not 0 <= self.seed < 2**63:
            raise InputError(f"--seed: expected 0 <= seed < 2**63, found {self.seed}")
        if self.length not in LENGTHS:
            raise InputError(f"length: expected one of {LENGTHS}, found {self.length!r}")

    def offsets(self, objects: Objects, seq: int) -> np.ndarray:
        """Shifts (R, 2) of the rows of `objects`, all labels of a sequence; see `of_rows`."""
        return self.of_rows(objects.frame, objects.track_id, objects.boxes, seq)

    def of_rows(
        self, frame: np.ndarray, track_id: np.ndarray, boxes: np.ndarray, seq: int = 0
    ) -> np.ndarray:
        """Shifts that keep the boxes of each frame clear of each other.

        They do not depend on the order of the rows. Rows without an id or a box (DontCare) get 0.

        Args:
            frame, track_id: (R,) int; no id >= 0 occurs twice in a frame.
            boxes: (R, 7) level frame.
            seq: number of the sequence, part of the key of the draws.

        Returns:
            (R, 2) float64, metres along level x and y.
        """
        draws = self._draws(frame, track_id, seq, 1)[:, 0]
        draws[(track_id < 0) | np.isnan(boxes).any(axis=1)] = 0.0
        row, partner = self._close_pairs(frame, boxes)
        crowded = np.unique(row[track_id[row] >= 0])
        shift, now = draws, boxes.copy()
        shift[crowded] = 0.0
        now[:, :2] += shift
        if self.hold:  # all frames of an object move alike
            crowded = np.flatnonzero(np.isin(track_id, track_id[crowded]) & (track_id >= 0))
            shift[crowded], now[crowded] = 0.0, boxes[crowded]
        tries = self._draws(frame[crowded], track_id[crowded], seq, ATTEMPTS)
        for number in np.unique(track_id[crowded]):
            own = np.flatnonzero(track_id[crowded] == number)
            rows = crowded[own]
            chosen = np.flatnonzero(track_id[row] == number)
            owner = np.searchsorted(rows, row[chosen])
            shift[rows] = self._first_clear(boxes[rows], owner, now[partner[chosen]], tries[own])
            now[rows, :2] += shift[rows]
        return shift

    def _close_pairs(self, frame: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (i, j), each order once, that do not overlap but may once they are moved."""
        i, j = _pairs_in_frame(frame, frame)
        reach = self.distance * (np.sqrt(2.0) if self.length.startswith("per_axis") else 1.0)
        room = np.hypot(boxes[:, 3], boxes[:, 4]) / 2 + reach
        apart = np.hypot(boxes[i, 0] - boxes[j, 0], boxes[i, 1] - boxes[j, 1])
        near = np.flatnonzero((i != j) & (apart < room[i] + room[j]))
        i, j = i[near], j[near]
        clear = ~footprints_overlap(boxes[i], boxes[j])
        return i[clear], j[clear]

    def _first_clear(
        self, boxes: np.ndarray, owner: np.ndarray, obstacles: np.ndarray, draws: np.ndarray
    ) -> np.ndarray:
        """Shifts (n, 2) of the rows (n, 7) of one object: the first clear draw of (n, A, 2), or 0.

        `obstacles` (P, 7) are the boxes to keep clear of, obstacle p in the frame of row owner[p].
        """
        moved = np.repeat(boxes[:, None], draws.shape[1], axis=1)
        moved[..., :2] += draws
        clear = np.ones(draws.shape[:2], bool)
        hit = footprints_overlap(moved[owner], obstacles[:, None])
        np.logical_and.at(clear, owner, ~hit)
        if self.hold:
            clear[:] = clear.all(axis=0)
        first = draws[np.arange(len(boxes)), clear.argmax(axis=1)]
        return np.where(clear.any(axis=1)[:, None], first, 0.0)

    def _draws(
        self, frame: np.ndarray, track_id: np.ndarray, seq: int, attempts: int
    ) -> np.ndarray:
        """(R, attempts, 2) metres; a function of (seed, seq, frame, track id, attempt) alone."""
        frame = np.full(len(frame), _HELD) if self.hold else frame
        u, v = _uniform(self.seed, seq, frame, track_id, attempts)
        if self.length.startswith("per_axis"):
            least = 0 if self.length == "per_axis_positive" else -1
            return self.distance * (least + (1 - least) * np.stack([u, v], axis=-1))
        reach, angle = self.distance * (u if self.length == "uniform" else 1.0), 2 * np.pi * v
        return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)


def _uniform(
    seed: int, seq: int, frame: np.ndarray, track_id: np.ndarray, attempts: int
) -> np.ndarray:
    """(2, R, attempts) uniform numbers in [0, 1): two hashes of each key and attempt."""
    key = _mix(np.array([seed], np.uint64))
    for part in (seq, frame, track_id):
        key = _mix(key ^ np.asarray(part, np.int64).astype(np.uint64))
    number = np.arange(1, 2 * attempts + 1, dtype=np.uint64).reshape(attempts, 2).T
    hashes = _mix(key[None, :, None] ^ number[:, None])
    return (hashes >> np.uint64(11)).astype(np.float64) / 2**53


def _mix(value: np.ndarray) -> np.ndarray:
    """SplitMix64's step and finalizer (Steele, Lea, Flood, OOPSLA 2014) on uint64."""
    value = value + np.uint64(0x9E3779B97F4A7C15)  # wraps around, as it should
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


def shift_objects(objects: Objects, offsets: np.ndarray) -> Objects:
    """Moves each row's box by its offset (R, 2); alpha and 2-D box stay those of the image."""
    boxes = objects.boxes.copy()
    boxes[:, :2] += offsets
    return replace(objects, boxes=boxes)


def shift_points(points: np.ndarray, boxes: np.ndarray, offsets: np.ndarray) -> np.ndarray:
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


def shift_detections(detections: Objects, objects: Objects, offsets: np.ndarray) -> Objects:
    """Moves each detection with the object it overlaps most (largest BEV IoU above 0).

    Args:
        detections: (P rows) of the same sequence.
        objects: (R rows) where they are before they are moved.
        offsets: (R, 2) of the objects.
    """
    carried = np.zeros((len(detections), 2))
    row, partner = _pairs_in_frame(detections.frame, objects.frame)
    overlap = iou_bev_pairs(detections.boxes[row], objects.boxes[partner])
    order = np.argsort(overlap, kind="stable")
    order = order[overlap[order] > 0]
    carried[row[order]] = np.asarray(offsets)[partner[order]]  # the largest is written last
    return shift_objects(detections, carried)


def _pairs_in_frame(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (i, j) of all pairs with a[i] == b[j]."""
    order = np.argsort(b, kind="stable")
    first, last = (np.searchsorted(b[order], a, side=side) for side in ("left", "right"))
    count = last - first
    i = np.repeat(np.arange(len(a)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return i, order[np.repeat(first, count) + within]
