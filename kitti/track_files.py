"""Tracks as tables for other programs: comma-separated values and JSON lines."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.files import write_text
from kitti.labels import write_results
from kitti.objects import Objects

FIELDS = ("frame", "id", "class", "score", "x", "y", "z", "length", "width", "height", "heading")
"""Fields of a row. The box is in the level frame (x ahead, y left, z up; see docs/DATA.md): centre
and size in metres, heading in radians about z, from x to y."""
DECIMALS = 6


def rows_of(objects: Objects) -> list[dict[str, Any]]:
    """A dictionary with the keys `FIELDS` for each row."""
    columns = (
        objects.frame.tolist(),
        objects.track_id.tolist(),
        objects.type.tolist(),
        objects.score.round(DECIMALS).tolist(),
        objects.boxes.round(DECIMALS).tolist(),
    )
    return [
        dict(zip(FIELDS, (*head, *box), strict=True)) for *head, box in zip(*columns, strict=True)
    ]


def write_csv(path: str | Path, objects: Objects) -> None:
    """Writes a header of `FIELDS` and a line per row, atomically."""
    text = io.StringIO()
    table = csv.DictWriter(text, FIELDS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows_of(objects))
    write_text(path, text.getvalue())


def write_json_lines(path: str | Path, objects: Objects) -> None:
    """Writes a JSON object with the keys `FIELDS` per row, atomically."""
    lines = (json.dumps(row, allow_nan=False) + "\n" for row in rows_of(objects))
    write_text(path, "".join(lines))


WRITERS: dict[str, tuple[str, Callable[[Path, Objects], None]]] = {
    "kitti": (".txt", write_results),
    "csv": (".csv", write_csv),
    "jsonl": (".jsonl", write_json_lines),
}
"""By the name of the format: suffix and writer."""


def parse_formats(text: str) -> tuple[str, ...]:
    """Reads `kitti` or `kitti,csv,jsonl`.

    Raises:
        InputError: an unknown or repeated format.
    """
    names = tuple(part.strip() for part in text.split(","))
    if not set(names) <= set(WRITERS) or len(set(names)) < len(names):
        raise InputError(f"--format: expected among {','.join(WRITERS)}, found {text!r}")
    return names


def write_tracks(folder: Path, name: str, objects: Objects, formats: tuple[str, ...]) -> list[Path]:
    """Writes `folder/NAME.<suffix>` in each format; returns the files."""
    written = []
    for suffix, write in (WRITERS[key] for key in formats):
        written.append(folder / f"{name}{suffix}")
        write(written[-1], objects)
    return written
