"""Metrics over score thresholds: sAMOTA, AMOTA, AMOTP and the threshold of the best MOTA.

Source: Weng et al., "3D Multi-Object Tracking: A Baseline and New Evaluation Metrics", IROS 2020,
equations 3 to 5, with the thresholds of the published evaluator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from metrics.counts import Counts, Outcome, total

RECALL_POINTS = 40  # recall 1/40, 2/40, ..., 1

OutcomesAt = Callable[[float | None, int], Sequence[Outcome]]


@dataclass(frozen=True)
class Sweep:
    """Means over the recall points, and the threshold (None: keep all) of the best MOTA > 0.

    `passes` is the number of passes over the data: one more than recall points.
    """

    samota: float | None
    amota: float | None
    amotp: float | None
    best_threshold: float | None
    best_mota: float | None
    passes: int

    def metrics(self) -> dict[str, float | None]:
        """The metrics by their published names; `best_*` are names of this project."""
        return {
            "sAMOTA": self.samota,
            "AMOTA": self.amota,
            "AMOTP": self.amotp,
            "best_MOTA": self.best_mota,
            "best_threshold": self.best_threshold,
        }


def sweep(outcomes_at: OutcomesAt) -> Sweep:
    """Evaluates a protocol at each recall point.

    Args:
        outcomes_at: the protocol's outcome of every sequence at a score threshold (None: of all
            results), given the number of passes before.

    Unreached recall points count 0 in the means.
    """
    everything = outcomes_at(None, 0)
    counts = total(outcome.counts for outcome in everything)
    if not counts.gt:
        return Sweep(None, None, None, None, None, 1)
    scores = np.concatenate([outcome.matched_scores for outcome in everything])
    thresholds, recalls = recall_thresholds(scores, counts.tp + counts.fn)
    sums, best, best_mota = np.zeros(3), None, 0.0
    for passes, (threshold, recall) in enumerate(zip(thresholds, recalls, strict=True), 1):
        at = total(outcome.counts for outcome in outcomes_at(threshold, passes))
        motp = at.similarity / at.tp if at.tp else 0.0
        sums += scaled_mota(at, recall), at.mota, motp
        if at.mota > best_mota:
            best, best_mota = threshold, at.mota
    samota, amota, amotp = (sums / RECALL_POINTS).tolist()
    best_mota = counts.mota if best is None else best_mota
    return Sweep(samota, amota, amotp, best, best_mota, 1 + len(thresholds))


def scaled_mota(counts: Counts, recall: float) -> float:
    """sMOTA of equation 5: MOTA relative to its maximum at this recall, within [0, 1]."""
    errors = counts.fn + counts.fp + counts.ids - (1.0 - recall) * counts.gt
    return min(1.0, max(0.0, 1.0 - errors / (recall * counts.gt)))


def recall_thresholds(scores: np.ndarray, evaluated: int) -> tuple[list[float], list[float]]:
    """Score thresholds whose recall is nearest to 1/40, 2/40, ..., and these recalls.

    Args:
        scores: of all matches, in any order.
        evaluated: number of evaluated ground-truth boxes, matched or not.
    """
    thresholds, recalls, recall = [], [], 0.0
    ordered = np.sort(scores)[::-1].tolist()
    for i, score in enumerate(ordered):
        here = (i + 1) / evaluated
        following = (i + 2) / evaluated
        if i + 1 < len(ordered) and following - recall < recall - here:
            continue  # the next match is nearer to this recall
        thresholds.append(score)
        recalls.append(recall)
        recall += 1.0 / RECALL_POINTS
    return thresholds[1:], recalls[1:]  # the first has recall 0
