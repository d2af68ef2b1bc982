"""Metrics of scored boxes frame by frame: recall at a precision, thresholds, calibration.

Letters: V true boxes, K detected boxes of a frame, S detected boxes of all frames.
"""

from typing import NamedTuple

import numpy as np

HIT, FALSE_ALARM, IGNORED = 1, 0, -1
BINS = 10  # of the score, for `reliability`


class ScoredBoxes(NamedTuple):
    """Detected boxes of all frames, best first."""

    scores: np.ndarray  # (S,) float64
    outcomes: np.ndarray  # (S,) int: HIT, FALSE_ALARM or IGNORED
    truth_points: np.ndarray  # (S,) int: points of the true box of a hit, 0 without one


def outcomes_of(
    iou: np.ndarray, scores: np.ndarray, counted: np.ndarray, ignorable: np.ndarray, min_iou: float
) -> tuple[np.ndarray, np.ndarray]:
    """Matches the boxes of a frame, best first, each to the free true box of largest IoU.

    Args:
        iou: (V, K). scores: (K,).
        counted: (V,) bool; a match with another true box is ignored.
        ignorable: (K,) bool, boxes that are not false alarms if unmatched.
        min_iou: least IoU of a match.

    Returns:
        (K,) outcomes, (K,) row of the matched true box or -1.
    """
    outcomes = np.where(ignorable, IGNORED, FALSE_ALARM)
    rows, free = np.full(len(scores), -1), np.ones(len(iou), bool)
    for column in np.argsort(-scores, kind="stable"):
        overlap = np.where(free, iou[:, column], -1.0)
        if overlap.max(initial=-1.0) >= min_iou:
            row = rows[column] = overlap.argmax()
            free[row] = False
            outcomes[column] = HIT if counted[row] else IGNORED
    return outcomes, rows


def collect(frames: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> ScoredBoxes:
    """(scores, outcomes, points of the matched true boxes) of each frame -> all, best first."""
    none = np.zeros(0), np.zeros(0, int), np.zeros(0, int)
    parts = zip(none, *frames, strict=True)
    scores, outcomes, points = (np.concatenate(part) for part in parts)
    order = np.argsort(-scores, kind="stable")
    return ScoredBoxes(scores[order], outcomes[order], points[order])


def threshold_at_precision(boxes: ScoredBoxes, precision: float) -> float:
    """The lowest score from which on hits / (hits + false alarms) reaches `precision`.

    Above every score if none does.
    """
    hits = np.cumsum(boxes.outcomes == HIT)
    counted = np.cumsum(boxes.outcomes != IGNORED)
    enough = (hits > 0) & (hits >= precision * counted)
    reached = np.flatnonzero(enough & _last_of_equals(boxes.scores))
    return float(boxes.scores[reached[-1]]) if len(reached) else np.inf


def best_threshold(groups: list[tuple[ScoredBoxes, int]]) -> float:
    """The score with the largest sum over groups of (hits - false alarms) / true boxes.

    groups: boxes and the count of true boxes, such as those of real and of simulated scans.
    Infinity if there are no boxes.
    """
    if not any(len(boxes.scores) for boxes, _ in groups):
        return np.inf
    scores = np.concatenate([boxes.scores for boxes, _ in groups])
    gain = np.concatenate(
        [((b.outcomes == HIT) - 1.0 * (b.outcomes == FALSE_ALARM)) / total for b, total in groups]
    )
    order = np.argsort(-scores, kind="stable")
    total = np.where(_last_of_equals(scores[order]), np.cumsum(gain[order]), -np.inf)
    return float(scores[order][total.argmax()])


def _last_of_equals(scores: np.ndarray) -> np.ndarray:
    """(S,) bool: the last of equal scores, which a threshold keeps or drops together."""
    return np.append(scores[1:] < scores[:-1], True)[: len(scores)]


class Reliability(NamedTuple):
    """Boxes by bins of their score; empty bins have NaN means."""

    count: np.ndarray  # (bins,)
    score: np.ndarray  # (bins,) mean score
    right: np.ndarray  # (bins,) share of boxes that are right


def reliability(scores: np.ndarray, right: np.ndarray) -> Reliability:
    """Scores (S,) in [0, 1] and whether each box is right (S,) bool -> equal bins of the score."""
    index = np.minimum((scores * BINS).astype(int), BINS - 1)
    count = np.bincount(index, minlength=BINS)
    with np.errstate(invalid="ignore"):
        means = (np.bincount(index, x, BINS) / count for x in (scores, right))
        return Reliability(count, *means)


def expected_calibration_error(table: Reliability) -> float:
    """Mean over boxes of |mean score - share that is right| of their bin."""
    filled = table.count > 0
    error = np.abs(table.score - table.right)[filled]
    return float(np.average(error, weights=table.count[filled]))
