"""Algorithm 1 of the paper, "Association to Trajectory": the trajectory generator (section III.4).

The boxes of frame t-1 are moved by the displacement of the points inside them and matched to the
boxes of frame t by IoU, here the generalised one (GIoU), which also ranks boxes that do not
overlap. The displacement is the network's prediction (`pointtracknet`), or the
labels' motion (`gt_displacement`, the paper's "gt_tracking" upper bound).
"""

from dataclasses import dataclass, field

import numpy as np

from common.errors import InputError
from kitti.boxes import points_in_boxes
from kitti.iou import iou_3d
from tracking.assignment import greedy
from tracking.frame_detections import FOREGROUND, FrameDetections
from tracking.interface import NO_CONTEXT, FrameContext, Tracks
from tracking.life_cycle import LifeCycle, Track
from tracking.similarity import SIMILARITY, check_similarity

SETTLED = 3  # detections of a track whose lost object is reported, as the baselines' probation
TAU = {"iou_3d": 0.01, "giou_3d": -0.4}
"""Least similarity of a match where no tau is given: chosen on training sequences."""


@dataclass(frozen=True)
class AssociationParameters:
    """Parameters of Algorithm 1; the paper names tau alone, without a value: all values are ours.

    Chosen on training sequences, see the tables in README.md of this folder.
    """

    similarity: str = "giou_3d"  # Algorithm 1: iou_3d; a displacement may miss by more than a car
    tau: float | None = None  # a match has more similarity; None: TAU
    max_age: int = 5  # frames that a lost object is kept: "short term disappearance" (section IV.E)
    min_hits: int = 1  # detections before a trajectory is reported; Algorithm 1 has no probation
    min_start_score: float = -np.inf  # least score that starts a trajectory; Algorithm 1 has none
    lost_frames: int = 1  # frames for which a lost object is reported; Algorithm 1 has none
    lost_points: int = 3  # if so many points of the mask lie in its moved box; 0: in any case
    duplicate_iou: float = 0.7  # two tracks of more 3-D IoU are one object; 1: Algorithm 1

    def __post_init__(self):
        check_similarity(self.similarity)
        for name, value, least, most in (
            ("tau", self.min_similarity, -1, 1),
            ("max_age", self.max_age, 0, np.inf),
            ("min_hits", self.min_hits, 1, np.inf),
            ("lost_frames", self.lost_frames, 0, np.inf),
            ("lost_points", self.lost_points, 0, np.inf),
            ("duplicate_iou", self.duplicate_iou, 0, 1),
        ):
            if not least <= value <= most:
                raise InputError(f"{name}: expected {least} to {most}, found {value}")
        if np.isnan(self.min_start_score):
            raise InputError("min_start_score: expected a number, found nan")

    @property
    def min_similarity(self) -> float:
        """tau of the paper, in terms of `similarity`."""
        return TAU[self.similarity] if self.tau is None else self.tau


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
        """Starts the frame; the boxes move in `update`, which receives the displacement."""
        self.life.begin_frame()

    def update(self, detections: FrameDetections, context: FrameContext = NO_CONTEXT) -> Tracks:
        """See `MultiObjectTracker.update`; line numbers are Algorithm 1's."""
        boxes, label_ids = detections.boxes, self.label_ids(detections, context)
        p, previous = self.parameters, self.life.tracks
        # lines 5-8: each B^{t-1} is moved by the mean displacement of its points
        moved = self._move(detections, context)
        # lines 9-12: the pairs of largest (G)IoU above tau, largest first so that it is one-to-one;
        # lines 13-15: the unmatched boxes of t-1 and of t
        matching = greedy(self._costs(moved, boxes), 1.0)
        # line 16: update the trajectories
        for row, column in matching.pairs:
            previous[row].state.box = boxes[column]
            previous[row].state.label_id = int(label_ids[column])
            self.life.hit(previous[row], detections, column)
        for row in matching.unmatched_rows:
            previous[row].state.box = moved[row]  # lost: keeps its displacement
        self._merge_duplicates(detections)
        for column in matching.unmatched_columns:  # lines 1-3 when t = 0
            if detections.scores[column] >= p.min_start_score:
                state = Motion(boxes[column], label_id=int(label_ids[column]))
                self.life.birth(state, detections, column)
        self.life.drop(lambda track: track.time_since_update > p.max_age)
        return self.life.report(
            lambda track: self._is_shown(track, detections), lambda track: track.state.box
        )

    def label_ids(self, detections: FrameDetections, context: FrameContext) -> np.ndarray:
        """(M,) label ids of the detections: -1, since the predicted displacement needs none."""
        return np.full(len(detections), -1)

    def box_displacement(
        self, boxes: np.ndarray, detections: FrameDetections, context: FrameContext
    ) -> np.ndarray:
        """(T, 3) metres, lines 6-7 for the boxes (T, 7) of t-1; NaN where unknown."""
        if detections.points is None:
            return np.full((len(boxes), 3), np.nan)
        d = detections
        return mean_displacement(d.points, d.displacement, boxes, d.foreground)

    def _move(self, detections: FrameDetections, context: FrameContext) -> np.ndarray:
        """Lines 6-8 for every box of t-1; returns (T, 7).

        A box without a kept point (or of unknown displacement) repeats its last displacement.
        """
        states = [track.state for track in self.life.tracks]
        boxes = np.array([state.box for state in states]).reshape(-1, 7)
        mean = self.box_displacement(boxes, detections, context)
        for state, moved in zip(states, mean, strict=True):
            if np.isfinite(moved).all():
                state.displacement = moved
        boxes[:, :3] += np.array([state.displacement for state in states]).reshape(-1, 3)
        return boxes

    def _costs(self, moved: np.ndarray, boxes: np.ndarray) -> np.ndarray:
        """(T, M) the negative similarity, infinite for pairs that do not match.

        A track in its probation matches only a box that overlaps it: else false boxes that lie
        apart would confirm each other.
        """
        p = self.parameters
        similarity = SIMILARITY[p.similarity](moved, boxes)
        matching = similarity > p.min_similarity
        new = np.array([track.hits < p.min_hits for track in self.life.tracks], bool)
        matching[new] &= iou_3d(moved[new], boxes) > TAU["iou_3d"]
        return np.where(matching, -similarity, np.inf)

    def _merge_duplicates(self, detections: FrameDetections) -> None:
        """Merges a lost track into a matched one that it overlaps; the one of more hits goes on.

        Two boxes on one vehicle start a second track, and a wrong displacement moves a lost vehicle
        onto its neighbour; the two tracks would then take the vehicle's detections in turn.
        """
        least = self.parameters.duplicate_iou
        if least == 1:
            return
        lost = [track for track in self.life.tracks if track.detection < 0]
        matched = [track for track in self.life.tracks if track.detection >= 0]
        both = (np.array([t.state.box for t in part]).reshape(-1, 7) for part in (lost, matched))
        iou, merged = iou_3d(*both), set()
        for row, column in greedy(np.where(iou > least, -iou, np.inf), 0.0).pairs:
            track, other = lost[row], matched[column]
            if track.hits > other.hits:  # it takes the detection over
                track.state = other.state
                self.life.hit(track, detections, other.detection)
                merged.add(other.id)
            else:
                merged.add(track.id)
        self.life.drop(lambda track: track.id in merged)

    def _is_shown(self, track: Track, detections: FrameDetections) -> bool:
        """True for a matched track past its probation; in the first frames for any matched one."""
        p = self.parameters
        settled = track.hits >= p.min_hits or self.life.frame_count <= p.min_hits
        return settled and (track.detection >= 0 or self._is_seen(track, detections))

    def _is_seen(self, track: Track, detections: FrameDetections) -> bool:
        """True for a lost object that is in the foreground mask, apart from all detected boxes."""
        p, box = self.parameters, track.state.box[np.newaxis]
        if track.hits < SETTLED or track.time_since_update > p.lost_frames:
            return False
        if p.lost_points == 0:
            return True
        if detections.mask is None or iou_3d(box, detections.boxes).any():
            return False
        return int((points_in_boxes(detections.mask, box) >= 0).sum()) >= p.lost_points


class AssociationByLabels(AssociationToTrajectory):
    """Algorithm 1 with the labels' motion: the paper's upper bound "gt_tracking" (section IV.D)."""

    def label_ids(self, detections: FrameDetections, context: FrameContext) -> np.ndarray:
        """(M,) label ids of the detections, -1 for none."""
        if detections.label_ids is not None:
            return detections.label_ids
        motion = context.label_motion
        return (
            super().label_ids(detections, context)
            if motion is None
            else motion.ids_of(detections.boxes)
        )

    def box_displacement(
        self, boxes: np.ndarray, detections: FrameDetections, context: FrameContext
    ) -> np.ndarray:
        """(T, 3) metres, the motion of the labels of the boxes of t-1; NaN where unknown."""
        if context.label_motion is None:
            return np.full((len(boxes), 3), np.nan)
        ids = np.array([track.state.label_id for track in self.life.tracks], np.int64)
        return context.label_motion.displacement(ids)


def mean_displacement(
    points: np.ndarray,
    displacement: np.ndarray,
    boxes: np.ndarray,
    foreground: np.ndarray | None = None,
) -> np.ndarray:
    """Mean displacement of the points in each box (Algorithm 1, lines 6-7).

    Most of the N' kept points are background, such as the ground within a box; their displacement
    is trained towards 0 and would bias the mean. Only points of the foreground mask therefore
    count, unless a box has none.

    Args:
        points: (n, >=3) points of frame t-1, level frame; displacement: (n, 3), metres.
        boxes: (T, 7) boxes of frame t-1. A point in several boxes counts in each of them.
        foreground: (n,) probability of being foreground; None: 1 everywhere.

    Returns:
        (T, 3) metres, NaN for a box without points.
    """
    likely = np.ones(len(points), bool)
    if foreground is not None:
        likely = np.asarray(foreground) >= FOREGROUND
    mean = np.full((len(boxes), 3), np.nan)
    for row in range(len(boxes)):
        inside = points_in_boxes(points, boxes[row : row + 1]) >= 0
        chosen = inside & likely
        if inside.any():
            mean[row] = displacement[chosen if chosen.any() else inside].mean(axis=0)
    return mean
