"""Metrics as Markdown tables; metrics.json holds the same numbers."""

from collections.abc import Mapping
from typing import Any

from common.markdown import markdown

COUNTS = ("IDS", "FRAG", "TP", "FP", "FN", "GT")
CLEAR_COLUMNS = ("MOTA", "MOTP", "MT", "ML", *COUNTS)


def overall_table(metrics: Mapping[str, Any]) -> str:
    """One row per protocol: the metrics over all sequences together."""
    clear = {name: part["overall"] for name, part in metrics.items() if name != "hota"}
    text = ""
    if clear:
        rows = [[name, *(part[key] for key in CLEAR_COLUMNS)] for name, part in clear.items()]
        text = markdown(["protocol", *CLEAR_COLUMNS], rows)
    for name, part in metrics.items():
        extra = [key for key in part["overall"] if key not in CLEAR_COLUMNS]
        if extra:
            row = [name, *(part["overall"][key] for key in extra)]
            text += "\n" * bool(text) + markdown(["protocol", *extra], [row])
    return text


def threshold_line(thresholds: Mapping[str, float | None]) -> str:
    """A sentence on the least score of boxes and of tracks; empty without any."""
    boxes, tracks = thresholds["min_box_score"], thresholds["min_track_score"]
    text = "" if boxes is None else f"Boxes with a score of at least {boxes!r}.\n"
    return text + ("" if tracks is None else f"Tracks with a mean of at least {tracks!r}.\n")


def full_table(
    metrics: Mapping[str, Any], command: str, thresholds: Mapping[str, float | None]
) -> str:
    """`table.md`: over all sequences, then one table per protocol with a row per sequence."""
    head = f"# Metrics\n\nMade by `{command}`; ratios are fractions.\n{threshold_line(thresholds)}"
    text = f"{head}\n{overall_table(metrics)}"
    for name, part in metrics.items():
        columns = list(part["overall"] if name == "hota" else CLEAR_COLUMNS)
        rows = [
            [sequence, *(values[key] for key in columns)]
            for sequence, values in {**part["sequences"], "all": part["overall"]}.items()
        ]
        text += f"\n## {name}\n\n" + markdown(["sequence", *columns], rows)
    return text
