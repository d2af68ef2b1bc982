"""Colours, axes and boxes that all pictures share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from common.files import atomic_path
from kitti.boxes import box_corners

TRUTH, FOUND, POINTS = "tab:green", "tab:blue", "0.6"
_PALETTE = (
    "#e6194b", "#3cb44b", "#4363d8", "#f58231", "#911eb4", "#008080", "#9a6324", "#808000",
    "#f032e6", "#000075", "#800000", "#46c0d8", "#d4a017", "#6a8f3c", "#b05070", "#5a5a9c",
)  # fmt: skip
EDGES = ((0, 1, 2, 3, 0, 4, 5, 6, 7, 4), (1, 5), (2, 6), (3, 7))
"""Strokes through the corners of a box (see `kitti.boxes.box_corners`)."""


def id_color(track_id: int) -> str:
    """The colour of a track; neighbouring ids differ."""
    return _PALETTE[track_id % len(_PALETTE)]


def save(figure: Figure, path: str | Path, dpi: int = 130) -> Path:
    """Writes the figure as its suffix says (PNG, PDF, SVG), atomically."""
    path = Path(path)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi)
    return path


def birds_eye_axes(panel, x_range=(0.0, 72.0), y_range=(-30.0, 30.0)) -> None:
    """x forward to the right, y left upwards, metres, equal scale."""
    panel.set_aspect("equal")
    panel.set_xlim(*x_range)
    panel.set_ylim(*y_range)
    panel.set_xlabel("x forward (m)")
    panel.set_ylabel("y left (m)")


def draw_points(panel, points: np.ndarray, color=POINTS, size: float = 0.4, **style) -> None:
    """Points (n, >=2) from above."""
    panel.plot(points[:, 0], points[:, 1], ".", color=color, markersize=size, zorder=1, **style)


def outlines(boxes: np.ndarray) -> np.ndarray:
    """(M, 7) -> (M, 6, 2): outline from above, then a stroke to the middle of the front."""
    corners = box_corners(boxes)[:, :4, :2]
    front = corners[:, [0, 3]].mean(axis=1)
    return np.concatenate([corners[:, [3, 2, 1, 0, 3]], front[:, None]], axis=1)


def draw_boxes(panel, boxes: np.ndarray, color, **style) -> LineCollection:
    """Boxes (M, 7) from above; `color` is one colour or M of them."""
    lines = LineCollection(list(outlines(boxes)), colors=color, **style)
    panel.add_collection(lines)
    return lines


def draw_trails(panel, trails: dict[int, np.ndarray], color, **style) -> LineCollection:
    """Lines through centres (k, 3) from above; `color` is one colour or a function of the id."""
    colors = [color(i) for i in trails] if callable(color) else color
    lines = LineCollection([trail[:, :2] for trail in trails.values()], colors=colors, **style)
    panel.add_collection(lines)
    return lines
