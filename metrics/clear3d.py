"""Plain CLEAR MOT on 3-D boxes (Bernardin and Stiefelhagen, 2008), counted by motmetrics.

No ignore rules: every ground-truth box is evaluated, every unmatched result is a false alarm,
except ignorable results in `clear3d_dontcare`.
"""

from dataclasses import dataclass, replace

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


def clear3d(
    comparison: Comparison,
    keep: np.ndarray,
    min_iou: float = 0.5,
    ignorable: np.ndarray | None = None,
) -> Outcome:
    """Counts of one sequence.

    Args:
        comparison: with 3-D IoU as similarity, both sides limited to the evaluated classes.
        keep: (S,) bool, the results to evaluate.
        min_iou: a pair below it is never matched.
        ignorable: (S,) bool, results that are not false alarms if unmatched.

    The sum for MOTP is over IoU; motmetrics sums the distances 1 - IoU.
    """
    import motmetrics  # imports pandas, which takes a second

    accumulator = _accumulate(comparison, keep, min_iou)
    events = accumulator.events
    matches = events[events.Type.isin(["MATCH", "SWITCH"])]
    summary = motmetrics.metrics.create().compute(
        accumulator, metrics=list(COUNTED), return_dataframe=False
    )
    counts = _counts(summary, matches)
    if ignorable is not None:
        counts = replace(counts, fp=int((_false_alarms(comparison, events) & ~ignorable).sum()))
    return Outcome(counts, _matched_scores(comparison, matches))


@dataclass(frozen=True)
class RowErrors:
    """The errors that `clear3d` counts, row by row.

    Attributes:
        missed: (R,) bool, truth without a match.
        false_alarm: (S,) bool, results without a match; False where not evaluated.
        switched: (S,) bool, matches whose truth was matched to another id before.
        matched_id: (S,) int64, track id of the truth that a result is matched to, -1 without.
    """

    missed: np.ndarray
    false_alarm: np.ndarray
    switched: np.ndarray
    matched_id: np.ndarray


def row_errors(comparison: Comparison, keep: np.ndarray, min_iou: float = 0.5) -> RowErrors:
    """Misses, false alarms and id switches of one sequence; arguments as in `clear3d`.

    Their sums are the counts FN, FP and IDS of `clear3d`.
    """
    events = _accumulate(comparison, keep, min_iou).events
    truth, results = comparison.truth, comparison.results
    return RowErrors(
        missed=_rows_of(events, "MISS", "OId", truth.frame, truth.track_id),
        false_alarm=keep & _false_alarms(comparison, events),
        switched=keep & _rows_of(events, "SWITCH", "HId", results.frame, results.track_id),
        matched_id=_matched_ids(events, results.frame, results.track_id),
    )


def _matched_ids(events, frame: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """(rows,) int64: the id in OId of the match of a row's frame and id, -1 without one."""
    matches = events[events.Type.isin(["MATCH", "SWITCH"])]
    found = dict(zip(_keys(matches, "HId"), matches["OId"].astype(int).tolist(), strict=True))
    rows = zip(frame.tolist(), ids.tolist(), strict=True)
    return np.fromiter((found.get(row, -1) for row in rows), np.int64, len(frame))


def _false_alarms(comparison: Comparison, events) -> np.ndarray:
    results = comparison.results
    return _rows_of(events, "FP", "HId", results.frame, results.track_id)


def _rows_of(events, kind: str, column: str, frame: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """(rows,) bool: rows whose frame and id are those of an event of `kind`, ids in `column`."""
    found = set(_keys(events[events.Type == kind], column))
    rows = zip(frame.tolist(), ids.tolist(), strict=True)
    return np.fromiter((row in found for row in rows), bool, len(frame))


def _keys(events, column: str) -> list[tuple[int, int]]:
    """Frame and id of each event, ids in `column`."""
    frames = events.index.get_level_values("FrameId")
    return list(zip(frames.tolist(), events[column].astype(int).tolist(), strict=True))


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


def _counts(summary: dict, matches) -> Counts:
    matched = int(summary["num_matches"] + summary["num_switches"])
    return Counts(
        gt=int(summary["num_objects"]),
        tp=matched,
        fp=int(summary["num_false_positives"]),
        fn=int(summary["num_misses"]),
        ids=int(summary["num_switches"]),
        frag=int(summary["num_fragmentations"]),
        tracks=int(summary["num_unique_objects"]),
        mostly_tracked=int(summary["mostly_tracked"]),
        mostly_lost=int(summary["mostly_lost"]),
        similarity=matched - float(matches["D"].sum()),
    )


def _matched_scores(comparison: Comparison, matches) -> np.ndarray:
    ids, first = np.unique(comparison.results.track_id, return_index=True)
    matched_ids = matches["HId"].to_numpy(np.int64)
    return comparison.scores[first][np.searchsorted(ids, matched_ids)]
