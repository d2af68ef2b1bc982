"""Algorithm 1 of the paper, "Association to Trajectory" (section III.C.4).

The boxes of frame t-1 are moved by the displacement of the points inside them and matched to the
boxes of frame t by IoU. Where the displacement comes from is the caller's affair: the network's
(`pointtracknet`), or the labels' (`gt_displacement`, the paper's "gt_tracking" upper bound).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from common.errors import InputError
from kitti.boxes import points_in_boxes
from kitti.iou import iou_3d
from tracking.assignment import greedy
from tracking.interface import BoxDisplacement, Tracks, check_boxes, check_rows
from tracking.life_cycle import LifeCycle, Track

FOREGROUND = 0.5  # probability from which the mask calls a point foreground


@dataclass(frozen=True)
class AssociationParameters:
    """Algorithm 1 names only tau, and gives it no value: all values are ours.

    Chosen on training sequences, see the tables in README.md of this folder.
    """

    tau: float = 0.01  # least IoU of a match; less is better the noisier the displacement
    max_age: int = 5  # frames a lost object goes on: "short term disappearance" (section IV.E)
    min_hits: int = 1  # detections before a trajectory is reported; Algorithm 1 has no probation
    min_start_score: float = -np.inf  # least score that starts a trajectory; Algorithm 1 has none
    report_lost: bool = False  # report the moved box of a lost object; costs 6 % MOTA


@dataclass
class Motion:
    """A track's box at t-1 (then t), (7,); the displacement that moved it last, (3,); label id."""

    box: np.ndarray
    displacement: np.ndarray = field(default_factory=lambda: np.zeros(3))
    label_id: int = -1


class AssociationToTrajectory:
    """Algorithm 1 for one sequence."""

    def __init__(self, parameters: AssociationParameters | None = None):
        self.parameters = parameters or AssociationParameters()
        self.life = LifeCycle()

    def predict(self) -> None:
        """Nothing moves yet: the displacement comes with `update`."""
        self.life.begin_frame()

    def update(
        self,
        boxes,
        scores,
        *,
        points: np.ndarray | None = None,
        displacement: np.ndarray | None = None,
        foreground: np.ndarray | None = None,
        box_displacement: BoxDisplacement | None = None,
        ids: np.ndarray | None = None,
        frame: int | None = None,
        **_unused,
    ) -> Tracks:
        """See `Tracker.update`; line numbers are Algorithm 1's."""
        boxes, scores = check_boxes(boxes, scores, frame)
        label_ids = np.full(len(boxes), -1) if ids is None else np.asarray(ids)
        p, previous = self.parameters, self.life.tracks
        # lines 5-8: each B^{t-1} is moved by the mean displacement of its points
        moved = self._move(points, displacement, foreground, box_displacement)
        # lines 9-12: the pairs of largest IoU above tau, largest first so that it is one-to-one;
        # lines 13-15: what is left of t-1 and of t
        matching = greedy(-iou_3d(moved, boxes), -p.tau)
        # line 16: update the trajectories
        for row, column in matching.pairs:
            previous[row].state.box = boxes[column]
            previous[row].state.label_id = int(label_ids[column])
            self.life.hit(previous[row], scores[column], column)
        for row in matching.unmatched_rows:
            previous[row].state.box = moved[row]  # lost: goes on with its displacement
        for column in matching.unmatched_columns:  # lines 1-3 when t = 0
            if scores[column] >= p.min_start_score:
                state = Motion(boxes[column], label_id=int(label_ids[column]))
                self.life.birth(state, scores[column], column)
        self.life.bury(lambda track: track.time_since_update > p.max_age)
        return self.life.report(self._is_shown, lambda track: track.state.box)

    def _move(self, points, displacement, foreground, box_displacement) -> np.ndarray:
        """Lines 6-8 for every box of t-1; returns (T, 7).

        A box without a kept point (or of unknown displacement) moves as it did last.
        """
        states = [track.state for track in self.life.tracks]
        boxes = np.array([state.box for state in states]).reshape(-1, 7)
        if box_displacement is not None:
            ids = np.array([state.label_id for state in states], np.int64)
            mean = np.asarray(box_displacement(boxes, ids), np.float64)
            if mean.shape != (len(boxes), 3):
                raise InputError(f"expected box displacement ({len(boxes)}, 3), found {mean.shape}")
        elif points is not None:
            mean = mean_displacement(points, displacement, boxes, foreground)
        else:
            mean = np.full((len(boxes), 3), np.nan)
        for state, moved in zip(states, mean, strict=True):
            if np.isfinite(moved).all():
                state.displacement = moved
        boxes[:, :3] += np.array([state.displacement for state in states]).reshape(-1, 3)
        return boxes

    def _is_shown(self, track: Track) -> bool:
        present = track.detection >= 0 or self.parameters.report_lost
        return present and track.hits >= self.parameters.min_hits


def mean_displacement(
    points: np.ndarray,
    displacement: np.ndarray,
    boxes: np.ndarray,
    foreground: np.ndarray | None = None,
) -> np.ndarray:
    """Mean displacement of the points in each box (Algorithm 1, lines 6-7).

    The probability filter keeps N' points of which most are background, the ground within a box
    among them; their displacement is trained towards 0 and would slow every box down. So only
    points that the mask calls foreground count, unless a box holds none of them.

    Args:
        points: (n, >=3) points of frame t-1, level frame; displacement: (n, 3), metres.
        boxes: (T, 7) boxes of frame t-1. A point in several boxes counts in each of them.
        foreground: (n,) probability of being foreground; None: 1 everywhere.

    Returns:
        (T, 3) metres, NaN for a box without points. Raises `InputError` on shapes or NaN.
    """
    points = check_rows("points", points, None)
    displacement = check_rows("displacement", displacement, len(points), 3)
    likely = np.ones(len(points), bool)
    if foreground is not None:
        probability = check_rows("foreground", np.reshape(foreground, (-1, 1)), len(points), 1)
        likely = probability[:, 0] >= FOREGROUND
    mean = np.full((len(boxes), 3), np.nan)
    for row in range(len(boxes)):
        inside = points_in_boxes(points, boxes[row : row + 1]) >= 0
        chosen = inside & likely
        if inside.any():
            mean[row] = displacement[chosen if chosen.any() else inside].mean(axis=0)
    return mean
