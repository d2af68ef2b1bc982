"""Logs of a training: history.csv, curves as PNG, TensorBoard."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import tensorflow as tf
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from common.errors import InputError
from common.files import atomic_path, write_text

COUNTS = ("epoch", "step")
"""Columns of every history, whole numbers; the others are metrics."""


class History:
    """Rows of metrics, one per epoch, kept in history.csv and rewritten whole each time."""

    def __init__(self, path: str | Path, last_step: int = 0):
        self.path = Path(path)
        self.rows = [row for row in self._read() if row["step"] <= last_step]

    def _read(self) -> list[dict[str, Any]]:
        if not self.path.exists():
            return []
        try:
            with self.path.open(newline="", encoding="utf-8") as file:
                rows = [
                    {key: float(value) for key, value in row.items()}
                    for row in csv.DictReader(file)
                ]
            for row in rows[:1]:
                if not {*COUNTS} <= set(row):
                    raise InputError(f"expected columns {' and '.join(COUNTS)}", self.path, 1)
            if not all(row[name].is_integer() for row in rows for name in COUNTS):
                raise ValueError(f"expected whole numbers as {' and '.join(COUNTS)}")
        except InputError:
            raise
        except (UnicodeDecodeError, ValueError, TypeError, csv.Error) as error:
            raise InputError(f"not a training history ({error})", self.path) from error
        return rows

    def _columns(self) -> list[str]:
        return list(dict.fromkeys(name for row in self.rows for name in row))

    def add(self, row: dict[str, float]) -> None:
        """Adds a row and writes the file anew, atomically; a figure that a row lacks is nan."""
        self.rows.append(row)
        text, columns = io.StringIO(), self._columns()
        writer = csv.DictWriter(text, fieldnames=columns, lineterminator="\n")
        writer.writeheader()
        for r in self.rows:
            writer.writerow({key: _text(key, r.get(key, float("nan"))) for key in columns})
        write_text(self.path, text.getvalue())

    def plot(self, path: str | Path) -> None:
        """Draws every column over the epochs, a panel each."""
        names = [name for name in self._columns() if name not in COUNTS]
        columns = 4
        lines = -(-len(names) // columns)
        figure = Figure(figsize=(4 * columns, 2.6 * lines), layout="constrained")
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        epochs = [row["epoch"] for row in self.rows]
        for panel, name in zip(panels, names, strict=False):
            panel.plot(epochs, [row.get(name, np.nan) for row in self.rows], marker=".")
            panel.set_title(name, fontsize=9)
            panel.set_xlabel("epoch", fontsize=8)
        for panel in panels[len(names) :]:
            panel.set_visible(False)
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=100)


def _text(name: str, value: float) -> str:
    return str(int(value)) if name in COUNTS else f"{value:.6g}"


class TensorBoard:
    """Scalars and pictures for TensorBoard."""

    def __init__(self, folder: str | Path):
        self.writer = tf.summary.create_file_writer(str(folder))

    def scalars(self, step: int, values: dict[str, float]) -> None:
        """Writes each value under its name."""
        with self.writer.as_default():
            for name, value in values.items():
                tf.summary.scalar(name, value, step=step)
        self.writer.flush()

    def picture(self, step: int, name: str, figure: Figure) -> None:
        """Writes a matplotlib figure."""
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[..., :3]
        with self.writer.as_default():
            tf.summary.image(name, pixels[None], step=step)
        self.writer.flush()
