"""The KITTI server's rules on 2-D boxes, as TrackEval applies them (`Kitti2DBox` and `CLEAR`)."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from kitti.iou import EPS
from metrics.comparison import Comparison
from metrics.counts import Counts, Outcome
from metrics.kitti_rules import RULES, KittiRules

MIN_SIMILARITY = 0.5  # the server's, for matching and for the ignore rules
CONTINUE = 1000.0  # weight of keeping last frame's match over a better overlap


@dataclass(frozen=True)
class CleanFrame:
    """One frame after the ignore rules: ids (M,) and (K,), similarity (M, K), scores (K,)."""

    truth_ids: np.ndarray
    result_ids: np.ndarray
    similarity: np.ndarray
    scores: np.ndarray


def kitti2d(
    comparison: Comparison,
    keep: np.ndarray,
    ignored: np.ndarray,
    ignorable: np.ndarray,
    rules: KittiRules = RULES,
) -> Outcome:
    """Counts of one sequence.

    Args:
        comparison: truth of the evaluated class and its neighbours (Car and Van), results of the
            evaluated class, with 2-D IoU as similarity.
        keep: (S,) bool, the results to evaluate.
        ignored: (R,) bool from `kitti_rules.ignored_truth`.
        ignorable: (S,) bool from `kitti_rules.ignorable_results`.
        rules: the benchmark's constants.
    """
    return clear(clean(comparison, keep, ignored, ignorable), rules)


def clean(
    comparison: Comparison, keep: np.ndarray, ignored: np.ndarray, ignorable: np.ndarray
) -> list[CleanFrame]:
    """Frames without ignored truth, and without results that match it or are ignorable."""
    frames = []
    for i, j, similarity in zip(
        comparison.truth_rows, comparison.result_rows, comparison.similarity, strict=True
    ):
        kept = keep[j]
        columns, similarity = j[kept], similarity[:, kept]
        drop = ignorable[columns].copy()
        rows_matched, columns_matched = _matches(similarity)
        drop[columns_matched] = ignored[i[rows_matched]]
        evaluated = ~ignored[i]
        frames.append(
            CleanFrame(
                comparison.truth.track_id[i[evaluated]],
                comparison.results.track_id[columns[~drop]],
                similarity[np.ix_(evaluated, ~drop)],
                comparison.scores[columns[~drop]],
            )
        )
    return frames


def _matches(similarity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of the largest total similarity; pairs under the threshold do not count."""
    weights = np.where(similarity < MIN_SIMILARITY - EPS, 0.0, similarity)
    return _assign(weights)


def _assign(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = linear_sum_assignment(-weights)
    matched = weights[rows, columns] > EPS
    return rows[matched], columns[matched]


def clear(frames: list[CleanFrame], rules: KittiRules = RULES) -> Outcome:
    """CLEAR over cleaned frames; a match of the frame before is continued where possible.

    A frame without any result keeps the matches of the frame before, so a gap there adds no
    fragmentation, as in TrackEval and on the server.
    """
    present: dict[int, int] = {}
    matched: dict[int, int] = {}
    starts: dict[int, int] = {}
    last: dict[int, int] = {}
    current: dict[int, int] = {}
    tp = fp = ids = 0
    similarity, scores = 0.0, []
    for frame in frames:
        for k in frame.truth_ids.tolist():
            present[k] = present.get(k, 0) + 1
        if not len(frame.truth_ids) or not len(frame.result_ids):
            fp += len(frame.result_ids)
            continue
        previous, current = current, {}
        rows, columns = _continue(frame, previous)
        pairs = zip(frame.truth_ids[rows].tolist(), frame.result_ids[columns].tolist(), strict=True)
        for k, result in pairs:
            ids += last.get(k, result) != result
            starts[k] = starts.get(k, 0) + (k not in previous)
            matched[k] = matched.get(k, 0) + 1
            last[k] = current[k] = result
        tp += len(rows)
        fp += len(frame.result_ids) - len(rows)
        similarity += float(frame.similarity[rows, columns].sum())
        scores.append(frame.scores[columns])
    gt = sum(present.values())
    share = [matched.get(k, 0) / n for k, n in present.items()]
    counts = Counts(
        gt=gt,
        tp=tp,
        fp=fp,
        fn=gt - tp,
        ids=ids,
        frag=sum(starts.values()) - len(starts),
        tracks=len(present),
        mostly_tracked=sum(s > rules.mostly_tracked for s in share),
        mostly_lost=sum(s < rules.mostly_lost for s in share),
        similarity=similarity,
    )
    return Outcome(counts, np.concatenate([np.zeros(0), *scores]))


def _continue(frame: CleanFrame, previous: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Keeps last frame's matches first, then the largest total similarity."""
    before = np.array([previous.get(k, -1) for k in frame.truth_ids.tolist()])
    weights = CONTINUE * (before[:, None] == frame.result_ids[None, :]) + frame.similarity
    return _assign(np.where(frame.similarity < MIN_SIMILARITY - EPS, 0.0, weights))
