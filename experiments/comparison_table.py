"""The demo's table: each tracker at each displacement, the paper's row beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evaluation.table import cell, markdown
from experiments.paper import TABLE5, TABLE5_COLUMNS
from experiments.runs import TRACKER_NAMES

HEADER = ("method", "D (m)", "from", *TABLE5_COLUMNS, "s/frame")
NAMES = {**TRACKER_NAMES, "pointtracknet": "PointTrackNet"}
PAPER_SECONDS = {"PointTrackNet": 0.099}  # Table II, N = 15000, N' = 5000, GTX 1080 Ti
PAPER, OURS = "paper, KITTI", "ours"

Row = tuple[str, list[str]]


def comparison_rows(records: Mapping[float, Mapping[str, Any]], ours: str) -> list[Row]:
    """Rows with their class, "ours" (PointTrackNet), "paper" or "".

    Args:
        records: displacement -> tracker -> what `evaluate_cached` returned.
        ours: name of our data in the third column, such as "ours, simulated".
    """
    rows: list[Row] = []
    for distance, trackers in records.items():
        for tracker, record in trackers.items():
            name, figures = NAMES[tracker], record["clear3d"]["overall"]
            seconds = record["seconds_per_frame"]["total"]
            cells = [_cell(figures[column]) for column in TABLE5_COLUMNS]
            kind = "ours" if tracker == "pointtracknet" else ""
            rows.append((kind, [name, f"{distance:g}", ours, *cells, f"{seconds:.3f}"]))
            printed = TABLE5["predicted"].get(name, {}).get(distance)
            if printed is not None:
                time = PAPER_SECONDS.get(name)
                cells = [_cell(value) for value in printed]
                rows.append(("paper", [name, f"{distance:g}", PAPER, *cells, _cell(time)]))
    return rows


def comparison_markdown(rows: list[Row]) -> str:
    """The rows for Markdown and for the terminal."""
    return markdown(HEADER, [cells for _, cells in rows])


def _cell(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else cell(value)
