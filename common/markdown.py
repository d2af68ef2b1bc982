"""Markdown tables with aligned columns, readable in a terminal too."""

from collections.abc import Sequence
from typing import Any


def cell(value: Any, decimals: int = 4) -> str:
    """Ratios with so many decimals, counts as they are, a dash for an undefined value."""
    if value is None:
        return "-"
    return f"{value:.{decimals}f}" if isinstance(value, float) else str(value)


def markdown(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table whose first column is left-aligned and whose others are right-aligned."""
    table = [list(header), *([cell(value) for value in row] for row in rows)]
    widths = [max(3, *(len(row[i]) for row in table)) for i in range(len(header))]
    table.insert(1, ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])])
    return "".join("| " + " | ".join(_padded(row, widths)) + " |\n" for row in table)


def _padded(row: list[str], widths: list[int]) -> list[str]:
    first, *others = zip(row, widths, strict=True)
    return [first[0].ljust(first[1]), *(text.rjust(width) for text, width in others)]
