"""Calibration of box scores, and recall before and after: metrics, diagram, table."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from common.files import atomic_path
from common.markdown import markdown
from metrics.scored_boxes import (
    HIT,
    ScoredBoxes,
    expected_calibration_error,
    reliability,
    threshold_at_precision,
)
from training.scoring.box_candidates import Candidates
from training.scoring.score_fit import MIN_POINTS, counted_boxes, counted_vehicles, scored

PRECISION = 0.9
MIN_IOUS = (0.25, 0.5)
POINTS = {"all": (MIN_POINTS, np.inf), "10 to 50 points": (10, 50), "50 points": (50, np.inf)}


def report(frames: list[Candidates], scores: list[np.ndarray], min_score: float) -> dict[str, Any]:
    """Calibration of the scores, and recall before (agreement) and after."""
    probability, right = counted_boxes(frames, scores)
    kept = probability >= min_score
    metrics: dict[str, Any] = {
        "frames": len(frames),
        "vehicles": counted_vehicles(frames),
        "boxes": len(right),
        "right": int(right.sum()),
        "expected_calibration_error": _error(probability, right),
        "expected_calibration_error_kept": _error(probability[kept], right[kept]),
        "reliability": [
            [None if np.isnan(value) else float(value) for value in row]
            for row in zip(*reliability(probability, right), strict=True)
        ],
    }
    agreement = [frame.scores(None) for frame in frames]
    for min_iou in MIN_IOUS:
        before, after = (scored(frames, s, min_iou) for s in (agreement, scores))
        metrics[f"IoU {min_iou}"] = {
            "before": _recall(before, frames),
            "after": _recall(after, frames),
            "at the default threshold": _at(after, frames, min_score),
        }
    return metrics


def _error(probability: np.ndarray, right: np.ndarray) -> float | None:
    if not len(right):
        return None
    return expected_calibration_error(reliability(probability, right))


def _recall(boxes: ScoredBoxes, frames: list[Candidates]) -> dict[str, float]:
    """Recall at `PRECISION`, by points of the vehicle."""
    hit = (boxes.outcomes == HIT) & (boxes.scores >= threshold_at_precision(boxes, PRECISION))
    points = boxes.truth_points[hit]
    return {
        name: float(((points >= low) & (points < high)).sum())
        / max(counted_vehicles(frames, low, high), 1)
        for name, (low, high) in POINTS.items()
    }


def _at(boxes: ScoredBoxes, frames: list[Candidates], min_score: float) -> dict[str, float]:
    outcomes = boxes.outcomes[boxes.scores >= min_score]
    hits, counted = int((outcomes == HIT).sum()), int((outcomes >= 0).sum())
    return {
        "recall": hits / max(counted_vehicles(frames), 1),
        "precision": hits / max(counted, 1),
    }


def draw(parts: dict[str, dict[str, Any]], path: Path) -> None:
    """Writes the reliability diagram: share of right boxes over mean score, with their number."""
    figure = Figure(figsize=(4.2 * len(parts), 4.2), layout="constrained")
    for column, (name, metrics) in enumerate(parts.items()):
        panel = figure.add_subplot(1, len(parts), column + 1)
        rows = [row for row in metrics["reliability"] if row[0]]
        panel.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
        panel.plot([r[1] for r in rows], [r[2] for r in rows], marker="o")
        for count, mean, share in rows:
            panel.annotate(
                f"{count:g}", (mean, share), fontsize=7, textcoords="offset points", xytext=(4, -8)
            )
        panel.set(xlabel="mean score", ylabel="share right at IoU 0.5", xlim=(0, 1), ylim=(0, 1))
        panel.set_title(f"{name}: calibration error {_shown(metrics)}")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _shown(metrics: dict[str, Any]) -> str:
    """The calibration error with three digits; a dash where there are no boxes."""
    error = metrics["expected_calibration_error"]
    return "-" if error is None else f"{error:.3f}"


def table(parts: dict[str, dict[str, Any]]) -> str:
    """Recall at the precision, before and after, as Markdown."""
    rows = []
    for name, metrics in parts.items():
        for min_iou in MIN_IOUS:
            both = metrics[f"IoU {min_iou}"]
            cells = [f"{both['before'][p]:.3f} -> {both['after'][p]:.3f}" for p in POINTS]
            rows.append([name, str(min_iou), *cells, _shown(metrics)])
    return markdown(["drives", "IoU", *POINTS, "calibration error"], rows)
