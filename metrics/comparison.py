"""Ground truth and results of one sequence, frame by frame, with their similarities.

Letters: R rows of the truth, S rows of the results, F frames, M and K rows in one frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kitti.objects import Objects

Similarity = Callable[[np.ndarray, np.ndarray], np.ndarray]
EXACT = 2**53
"""From here on float64 does not hold every integer."""


@dataclass(frozen=True)
class Comparison:
    """One sequence as input of a protocol.

    Attributes:
        name: the sequence, like "0016".
        truth, results: R and S rows in any order; ids are unique within a frame.
        truth_rows, result_rows: per frame (F of them), indices into `truth` and `results`.
        similarity: per frame, (M, K) float64 in [0, 1].
        track: (S,) index of each row's track.
        scores: (S,) float64, the mean score of each row's track; -1 where a file has no score.
    """

    name: str
    truth: Objects
    results: Objects
    truth_rows: list[np.ndarray]
    result_rows: list[np.ndarray]
    similarity: list[np.ndarray]
    track: np.ndarray
    scores: np.ndarray

    @property
    def num_frames(self) -> int:
        """F."""
        return len(self.truth_rows)

    def above(self, threshold: float | None, earlier_passes: int = 0) -> np.ndarray:
        """(S,) bool: rows whose track has a mean score of at least `threshold` (None: all).

        AB3DMOT's evaluator replaces each score by its track's mean in every pass over the data:
        the n-th pass compares means of means, and rounding can drop a track at the threshold that
        is its own score. `earlier_passes` reproduces that, for equal counts.
        """
        if threshold is None:
            return np.ones(len(self.results), bool)
        scores = self.scores
        for _ in range(earlier_passes):
            scores = mean_per_track(scores, self.track)
        return scores >= threshold


def compare(
    name: str,
    num_frames: int,
    truth: Objects,
    results: Objects,
    similarity: Similarity,
    *,
    field: str = "boxes",
) -> Comparison:
    """Sorts rows into frames and computes `similarity(truth.field, results.field)` in each."""
    truth, results = with_exact_ids(truth), with_exact_ids(results)
    truth_rows = rows_by_frame(truth.frame, num_frames)
    result_rows = rows_by_frame(results.frame, num_frames)
    a, b = getattr(truth, field), getattr(results, field)
    values = [
        similarity(a[i], b[j]) if len(i) and len(j) else np.zeros((len(i), len(j)))
        for i, j in zip(truth_rows, result_rows, strict=True)
    ]
    _, track = np.unique(results.track_id, return_inverse=True)
    scores = track_scores(results)
    return Comparison(name, truth, results, truth_rows, result_rows, values, track, scores)


def with_exact_ids(objects: Objects) -> Objects:
    """Ids beyond float64's integers, which motmetrics would round, are numbered anew from 0."""
    if np.abs(objects.track_id).max(initial=0) < EXACT:
        return objects
    ids, numbers = np.unique(objects.track_id, return_inverse=True)
    return replace(objects, track_id=np.where(objects.track_id < 0, -1, numbers - (ids < 0).sum()))


def rows_by_frame(frame: np.ndarray, num_frames: int) -> list[np.ndarray]:
    """Indices of the rows of each of `num_frames` frames, in the order of the rows."""
    order = np.argsort(frame, kind="stable")
    edges = np.searchsorted(frame[order], np.arange(num_frames + 1))
    return [order[first:last] for first, last in pairwise(edges)]


def track_scores(results: Objects, classes: Sequence[str] | None = None) -> np.ndarray:
    """(S,) the mean score over the track of each row; a missing score counts as -1.

    A threshold keeps or drops whole tracks, as AB3DMOT's evaluator does. With `classes`, the mean
    is over a track's rows of these classes where it has any.
    """
    scores = np.where(np.isnan(results.score), -1.0, results.score)
    _, track = np.unique(results.track_id, return_inverse=True)
    means = mean_per_track(scores, track)
    if classes is None:
        return means
    counted = np.isin(results.type, classes)
    some = np.isin(track, track[counted])
    return np.where(some, mean_per_track(scores, track, counted), means)


def mean_per_track(
    scores: np.ndarray, track: np.ndarray, counted: np.ndarray | None = None
) -> np.ndarray:
    """(S,) the mean of `scores` over the rows of each row's track, summed in file order.

    Of the rows `counted` (S,) bool alone, if given; 0 for a track without any.
    """
    if len(scores) == 0:
        return np.zeros(0)
    weights = np.ones(len(scores)) if counted is None else counted.astype(float)
    count = np.bincount(track, weights)
    return (np.bincount(track, weights * scores) / np.maximum(count, 1))[track]
