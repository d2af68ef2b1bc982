"""Figures as Markdown tables, for people; metrics.json is for machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

COUNTS = ("IDS", "FRAG", "TP", "FP", "FN", "GT")
CLEAR_COLUMNS = ("MOTA", "MOTP", "MT", "ML", *COUNTS)


def cell(value: Any) -> str:
    """Ratios with four decimals, counts as they are, a dash for what is undefined."""
    if value is None:
        return "-"
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def markdown(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table with aligned columns, ready for Markdown and for the terminal."""
    table = [list(header), *([cell(value) for value in row] for row in rows)]
    widths = [max(3, *(len(row[i]) for row in table)) for i in range(len(header))]
    table.insert(1, ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])])
    return "".join("| " + " | ".join(_padded(row, widths)) + " |\n" for row in table)


def _padded(row: list[str], widths: list[int]) -> list[str]:
    first, *others = zip(row, widths, strict=True)
    return [first[0].ljust(first[1]), *(text.rjust(width) for text, width in others)]


def overall_table(figures: Mapping[str, Any]) -> str:
    """One row per protocol: the figures over all sequences together."""
    clear = {name: part["overall"] for name, part in figures.items() if name != "hota"}
    text = ""
    if clear:
        rows = [[name, *(part[key] for key in CLEAR_COLUMNS)] for name, part in clear.items()]
        text = markdown(["protocol", *CLEAR_COLUMNS], rows)
    for name, part in figures.items():
        extra = [key for key in part["overall"] if key not in CLEAR_COLUMNS]
        if extra:
            row = [name, *(part["overall"][key] for key in extra)]
            text += "\n" * bool(text) + markdown(["protocol", *extra], [row])
    return text


def full_table(figures: Mapping[str, Any], command: str) -> str:
    """`table.md`: over all sequences, then one table per protocol with a row per sequence."""
    text = f"# Figures\n\nMade by `{command}`; ratios are fractions.\n\n{overall_table(figures)}"
    for name, part in figures.items():
        columns = list(part["overall"] if name == "hota" else CLEAR_COLUMNS)
        rows = [
            [sequence, *(values[key] for key in columns)]
            for sequence, values in {**part["sequences"], "all": part["overall"]}.items()
        ]
        text += f"\n## {name}\n\n" + markdown(["sequence", *columns], rows)
    return text
