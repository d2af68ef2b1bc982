"""DEEP_SORT (Wojke et al., ICIP 2017), on 3-D boxes of the level frame.

Confirmed tracks are matched in a cascade, the most recently matched first: gated by the Mahalanobis
distance of the Kalman filter, ranked by the cosine distance of appearance vectors. The rest is
matched by IoU, as in SORT. Without appearance vectors the Mahalanobis distance is also the rank.
"""

from dataclasses import dataclass

import numpy as np

from kitti.iou import iou_3d
from tracking.appearance import Gallery, normalize
from tracking.assignment import hungarian
from tracking.frame_detections import FrameDetections
from tracking.interface import NO_CONTEXT, FrameContext, Tracks
from tracking.kalman_box import KalmanBox, Noise
from tracking.life_cycle import LifeCycle, Track


def noise_of_scale(scale: float) -> Noise:
    """Noise of `scale` metres in the box, and in proportion in the other parts.

    The box of a new track has twice the deviation of a measurement, as in the authors' code; the
    velocity has 5/2 of it initially and 1/4 of it in each frame, twice the authors' proportions.
    """
    return Noise(
        initial_box=2 * scale,
        initial_velocity=2.5 * scale,
        process_box=scale,
        process_velocity=scale / 4,
        measured_position=scale,
        measured_size=scale,
        measured_yaw=scale,
    )


METRIC_NOISE = noise_of_scale(0.55)
"""The paper's noise is a share of the box height in pixels, which has no counterpart in metres.

This scale brings the row with ground-truth boxes at 2 m nearest to PointTrackNet's Table V on the
training sequences (studies/deep_sort_noise.py).
"""


@dataclass(frozen=True)
class DeepSortParameters:
    """Parameters of DEEP_SORT: the paper's; ours, in metres, in place of pixels."""

    gate: float = 7.8147  # section II.B: chi-square, 95 %, here for the 3 coordinates of the centre
    max_cosine_distance: float = 0.2  # t(2) of section II.B; the authors' default
    gallery_size: int = 100  # "L_k = 100", section II.B
    min_iou: float = 0.3  # the authors' default: IoU distance up to 0.7
    max_age: int = 30  # "A_max = 30 frames", section III
    min_hits: int = 3  # "first three frames" tentative, section II.A
    lost_frames: int = 0  # frames for which a lost track is reported; its authors' code: 1
    noise: Noise = METRIC_NOISE


@dataclass
class Identity:
    """A track's motion and appearance."""

    filter: KalmanBox
    gallery: Gallery


class DeepSort:
    """DEEP_SORT for one sequence."""

    def __init__(self, parameters: DeepSortParameters | None = None):
        self.parameters = parameters or DeepSortParameters()
        self.life = LifeCycle()

    def predict(self) -> None:
        """Kalman prediction of every track."""
        self.life.begin_frame()
        for track in self.life.tracks:
            track.state.filter.predict()

    def update(self, detections: FrameDetections, context: FrameContext = NO_CONTEXT) -> Tracks:
        """See `MultiObjectTracker.update`."""
        boxes, looks = detections.boxes, _appearance(detections)
        pairs, free = self._cascade(boxes, looks)
        pairs += self._by_iou(boxes, free, {id(track) for track, _ in pairs})
        for track, column in pairs:
            track.state.filter.update(boxes[column])
            track.state.gallery.add(looks[column])
            self.life.hit(track, detections, column)
        for column in sorted(free):
            state = Identity(
                KalmanBox(boxes[column], self.parameters.noise),
                Gallery(self.parameters.gallery_size),
            )
            state.gallery.add(looks[column])
            self.life.birth(state, detections, column)
        return self._finish(boxes)

    def _cascade(self, boxes, looks) -> tuple[list[tuple[Track, int]], set[int]]:
        """Listing 1: confirmed tracks in order of age; returns the pairs and the free columns."""
        pairs, free = [], set(range(len(boxes)))
        confirmed = [track for track in self.life.tracks if track.confirmed]
        for age in sorted({track.time_since_update for track in confirmed}):
            tracks = [track for track in confirmed if track.time_since_update == age]
            columns = sorted(free)
            if not columns:
                break
            cost = np.array([self._cost(t.state, boxes[columns], looks[columns]) for t in tracks])
            for row, column in hungarian(cost, 1.0).pairs:
                pairs.append((tracks[row], columns[column]))
                free.discard(columns[column])
        return pairs, free

    def _cost(self, state: Identity, boxes, looks) -> np.ndarray:
        """(M,) cost of giving each detection to a track, infinite beyond a gate, else in [0, 1].

        The cosine distance as a share of its gate; where no appearance is available the squared
        Mahalanobis distance as a share of its own (lambda = 1 in equation 5).
        """
        p = self.parameters
        motion = state.filter.squared_mahalanobis(boxes) / p.gate
        look = state.gallery.distances(looks) / p.max_cosine_distance
        cost = np.where(np.isnan(look), motion, look)
        return np.where((motion <= 1.0) & (cost <= 1.0), cost, np.inf)

    def _by_iou(self, boxes, free: set[int], matched: set[int]) -> list[tuple[Track, int]]:
        """Matches tentative tracks and those missed in this frame alone by IoU; updates `free`."""
        tracks = [
            track
            for track in self.life.tracks
            if id(track) not in matched and (not track.confirmed or track.time_since_update == 1)
        ]
        columns = sorted(free)
        predicted = np.array([track.state.filter.box for track in tracks]).reshape(-1, 7)
        cost = 1.0 - iou_3d(predicted, boxes[columns])
        pairs = []
        for row, column in hungarian(cost, 1.0 - self.parameters.min_iou).pairs:
            pairs.append((tracks[row], columns[column]))
            free.discard(columns[column])
        return pairs

    def _finish(self, boxes) -> Tracks:
        """Confirms and drops tracks; a tentative track dies at its first miss."""
        for track in self.life.tracks:
            track.confirmed = track.confirmed or track.hits >= self.parameters.min_hits
        self.life.drop(
            lambda t: t.time_since_update > (self.parameters.max_age if t.confirmed else 0)
        )
        return self.life.report(
            lambda t: t.confirmed and t.time_since_update <= self.parameters.lost_frames,
            lambda t: t.state.filter.box if t.detection < 0 else boxes[t.detection],
        )


def _appearance(detections: FrameDetections) -> np.ndarray:
    """(M, C) of unit length, rows of zeros without appearance."""
    if detections.appearance is None:
        return np.zeros((len(detections), 1))
    return normalize(detections.appearance)
