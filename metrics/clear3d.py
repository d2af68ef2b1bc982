"""Plain CLEAR MOT on 3-D boxes (Bernardin and Stiefelhagen, 2008), counted by motmetrics.

No ignore rules: every ground-truth box is asked for, every unmatched result is a false alarm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from metrics.comparison import Comparison
from metrics.counts import Counts, Outcome

COUNTED = (
    "num_objects",
    "num_matches",
    "num_switches",
    "num_false_positives",
    "num_misses",
    "num_fragmentations",
    "num_unique_objects",
    "mostly_tracked",
    "mostly_lost",
)


def clear3d(comparison: Comparison, keep: np.ndarray, min_iou: float = 0.5) -> Outcome:
    """Counts of one sequence.

    Args:
        comparison: with 3-D IoU as similarity, both sides limited to the classes asked for.
        keep: (S,) bool, the results that take part.
        min_iou: a pair below it is never matched.

    MOTP's sum is over IoU, where motmetrics sums distances 1 - IoU.
    """
    import motmetrics  # brings pandas along, a second at import

    accumulator = _accumulate(comparison, keep, min_iou)
    events = accumulator.events
    matches = events[events.Type.isin(["MATCH", "SWITCH"])]
    figures = motmetrics.metrics.create().compute(
        accumulator, metrics=list(COUNTED), return_dataframe=False
    )
    return Outcome(_counts(figures, matches), _matched_scores(comparison, matches))


@dataclass(frozen=True)
class RowErrors:
    """The errors that `clear3d` counts, row by row.

    Attributes:
        missed: (R,) bool, truth without a match.
        false_alarm: (S,) bool, results without a match; False where they do not take part.
        switched: (S,) bool, matches whose truth was matched to another id before.
    """

    missed: np.ndarray
    false_alarm: np.ndarray
    switched: np.ndarray


def row_errors(comparison: Comparison, keep: np.ndarray, min_iou: float = 0.5) -> RowErrors:
    """Misses, false alarms and id switches of one sequence; arguments as in `clear3d`.

    Their sums are the counts FN, FP and IDS of `clear3d`.
    """
    events = _accumulate(comparison, keep, min_iou).events
    truth, results = comparison.truth, comparison.results
    return RowErrors(
        missed=_rows_of(events, "MISS", "OId", truth.frame, truth.track_id),
        false_alarm=keep & _rows_of(events, "FP", "HId", results.frame, results.track_id),
        switched=keep & _rows_of(events, "SWITCH", "HId", results.frame, results.track_id),
    )


def _rows_of(events, kind: str, column: str, frame: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """(rows,) bool: which rows, by frame and id, the events of a kind name in `column`."""
    chosen = events[events.Type == kind]
    frames = chosen.index.get_level_values("FrameId")
    found = set(zip(frames.tolist(), chosen[column].astype(int).tolist(), strict=True))
    rows = zip(frame.tolist(), ids.tolist(), strict=True)
    return np.fromiter((row in found for row in rows), bool, len(frame))


def _accumulate(comparison: Comparison, keep: np.ndarray, min_iou: float):
    """A motmetrics accumulator that has matched every frame."""
    import motmetrics

    accumulator = motmetrics.MOTAccumulator()
    for frame in range(comparison.num_frames):
        rows, columns = comparison.truth_rows[frame], comparison.result_rows[frame]
        kept = keep[columns]
        similarity = comparison.similarity[frame][:, kept]
        accumulator.update(
            comparison.truth.track_id[rows],
            comparison.results.track_id[columns[kept]],
            np.where(similarity >= min_iou, 1.0 - similarity, np.nan),
            frameid=frame,
        )
    return accumulator


def _counts(figures: dict, matches) -> Counts:
    matched = int(figures["num_matches"] + figures["num_switches"])
    return Counts(
        gt=int(figures["num_objects"]),
        tp=matched,
        fp=int(figures["num_false_positives"]),
        fn=int(figures["num_misses"]),
        ids=int(figures["num_switches"]),
        frag=int(figures["num_fragmentations"]),
        tracks=int(figures["num_unique_objects"]),
        mostly_tracked=int(figures["mostly_tracked"]),
        mostly_lost=int(figures["mostly_lost"]),
        similarity=matched - float(matches["D"].sum()),
    )


def _matched_scores(comparison: Comparison, matches) -> np.ndarray:
    ids, first = np.unique(comparison.results.track_id, return_index=True)
    matched_ids = matches["HId"].to_numpy(np.int64)
    return comparison.scores[first][np.searchsorted(ids, matched_ids)]
