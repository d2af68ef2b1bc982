"""The steps that SORT and AB3DMOT share: Kalman prediction, Hungarian assignment, update, birth."""

from collections.abc import Callable
from typing import Any

import numpy as np

from tracking.assignment import hungarian
from tracking.frame_detections import FrameDetections
from tracking.life_cycle import LifeCycle

Similarity = Callable[[np.ndarray, np.ndarray], np.ndarray]


class KalmanTracker:
    """A Kalman filter per track, with `predict()`, `update(measured)` and `box`."""

    def __init__(self, parameters: Any):
        self.parameters = parameters
        self.life = LifeCycle()

    def predict(self) -> None:
        """Kalman prediction of every track."""
        self.life.begin_frame()
        for track in self.life.tracks:
            track.state.predict()

    def associate(
        self,
        detections: FrameDetections,
        measured: np.ndarray,
        rows: np.ndarray,
        similarity: Similarity,
        min_similarity: float,
        new_filter: Callable[[np.ndarray], Any],
    ) -> None:
        """Matches the measurements with the predicted boxes; updates, and starts new tracks.

        Args:
            detections: of this frame.
            measured: (K, S) their boxes in the filter's space; rows: (K,) their rows.
            similarity: (T, S), (K, S) -> (T, K), larger for a better pair.
            min_similarity: least similarity of a match.
            new_filter: a filter from its first measurement (S,).
        """
        tracks = self.life.tracks
        predicted = np.array([track.state.box for track in tracks])
        predicted = predicted.reshape(-1, measured.shape[1])
        matching = hungarian(1.0 - similarity(predicted, measured), 1.0 - min_similarity)
        for row, column in matching.pairs:
            tracks[row].state.update(measured[column])
            self.life.hit(tracks[row], detections, rows[column])
        for column in matching.unmatched_columns:
            self.life.birth(new_filter(measured[column]), detections, rows[column])
