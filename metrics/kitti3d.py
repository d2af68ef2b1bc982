"""KITTI's rules with 3-D IoU: the official devkit's counts as in AB3DMOT's evaluator.

Each frame is matched independently. Matched ignored boxes count as TP and in MOTP, but not in GT.
With another similarity in the comparison (2-D IoU) this is AB3DMOT's 2-D evaluation.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from metrics.comparison import Comparison
from metrics.counts import Counts, Outcome, total
from metrics.kitti_rules import RULES, KittiRules

NO_MATCH = 1e3  # cost of a pair that may not match; any full assignment of pairs costs less
UNMATCHED = -1


def kitti3d(
    comparison: Comparison,
    keep: np.ndarray,
    ignored: np.ndarray,
    ignorable: np.ndarray,
    *,
    min_iou: float,
    rules: KittiRules = RULES,
) -> Outcome:
    """Counts of one sequence.

    Args:
        comparison: truth and results of the evaluated class and its neighbours (Car and Van), with
            3-D IoU as similarity; ids from 0.
        keep: (S,) bool, the results to evaluate.
        ignored: (R,) bool from `kitti_rules.ignored_truth`.
        ignorable: (S,) bool from `kitti_rules.ignorable_results`.
        min_iou: a pair below it is never matched.
        rules: the benchmark's constants.
    """
    result_of = np.full(len(comparison.truth), UNMATCHED)
    false_alarms, similarity, matched_scores = 0, 0.0, []
    for i, j, values in zip(
        comparison.truth_rows, comparison.result_rows, comparison.similarity, strict=True
    ):
        columns = j[keep[j]]
        pairs = match(values[:, keep[j]], min_iou)
        similarity += float(values[:, keep[j]][pairs].sum())
        result_of[i[pairs[0]]] = comparison.results.track_id[columns[pairs[1]]]
        matched_scores.append(comparison.scores[columns[pairs[1]]])
        alone = np.delete(columns, pairs[1])
        false_alarms += int((~ignorable[alone]).sum())
    counts = Counts(
        gt=int((~ignored).sum()),
        tp=int((result_of != UNMATCHED).sum()),
        fp=false_alarms,
        fn=int(((result_of == UNMATCHED) & ~ignored).sum()),
        similarity=similarity,
    )
    histories = _histories(comparison, result_of, ignored)
    counts = total([counts, *(trajectory_counts(*history, rules) for history in histories)])
    return Outcome(counts, np.concatenate([np.zeros(0), *matched_scores]))


def match(similarity: np.ndarray, min_iou: float) -> tuple[np.ndarray, np.ndarray]:
    """The most allowed pairs, then the largest total similarity: rows, columns."""
    cost = 1.0 - similarity
    cost = np.where(cost <= 1.0 - min_iou, cost, NO_MATCH)
    rows, columns = linear_sum_assignment(cost)
    allowed = cost[rows, columns] < NO_MATCH
    return rows[allowed], columns[allowed]


def _histories(
    comparison: Comparison, result_of: np.ndarray, ignored: np.ndarray
) -> list[tuple[list[int], list[bool]]]:
    """Per ground-truth trajectory, over its own frames: matched result ids, ignored flags."""
    order = np.lexsort((comparison.truth.frame, comparison.truth.track_id))
    _, first = np.unique(comparison.truth.track_id[order], return_index=True)
    return [
        (result_of[rows].tolist(), ignored[rows].tolist())
        for rows in (np.split(order, first[1:]) if len(order) else [])
    ]


def trajectory_counts(matched: list[int], ignored: list[bool], rules: KittiRules = RULES) -> Counts:
    """IDS, FRAG, mostly tracked and mostly lost of one trajectory, as the devkit counts them.

    Args:
        matched: per frame in which the object is labelled, the result's id or -1.
        ignored: per such frame, whether the object is ignored there.
        rules: the benchmark's constants.

    An ignored first frame that is matched counts as tracked, as in the devkit.
    """
    if all(ignored):
        return Counts()
    if all(result == UNMATCHED for result in matched):
        return Counts(tracks=1, mostly_lost=1)
    ids, frag, tracked = _follow(matched, ignored)
    share = tracked / (len(matched) - sum(ignored))
    return Counts(
        ids=ids,
        frag=frag,
        tracks=1,
        mostly_tracked=int(share > rules.mostly_tracked),
        mostly_lost=int(share < rules.mostly_lost),
    )


def _follow(matched: list[int], ignored: list[bool]) -> tuple[int, int, int]:
    """Switches, fragmentations and tracked frames of a trajectory with at least one match."""
    last, final = matched[0], len(matched) - 1
    tracked, ids, frag = int(matched[0] != UNMATCHED), 0, 0
    for f in range(1, len(matched)):
        if ignored[f]:
            last = UNMATCHED
            continue
        here, before = matched[f], matched[f - 1]
        known = UNMATCHED not in (last, here)
        ids += known and last != here and before != UNMATCHED
        frag += known and f < final and before != here and matched[f + 1] != UNMATCHED
        if here != UNMATCHED:
            tracked += 1
            last = here
    if final > 0 and matched[-1] not in (UNMATCHED, matched[-2]) and not ignored[-1]:
        frag += 1
    return ids, frag, tracked
