"""Colours, axes and boxes that all pictures share."""

import colorsys
from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from common.files import atomic_path
from kitti.boxes import box_corners

TRUTH, FOUND, POINTS = "tab:green", "tab:blue", "0.6"
TEXT = 11  # points, in figures of about 7 inches: readable where a picture is as wide as a phone
_GOLDEN = 0.618034  # of a turn: consecutive hues are far apart and never repeat
ON_WHITE = (0.40, 0.25, 0.46, 0.33)
"""HLS lightness of consecutive ids."""
EDGES = ((0, 1, 2, 3, 0, 4, 5, 6, 7, 4), (1, 5), (2, 6), (3, 7))
"""Strokes through the corners of a box (see `kitti.boxes.box_corners`)."""


def id_color(track_id: int, lightness: tuple[float, ...] = ON_WHITE) -> str:
    """The colour of a track, #rrggbb: one for each id; by default dark enough for white paper."""
    hue = (0.45 + 0.83 * (track_id * _GOLDEN % 1.0)) % 1.0  # all but the green of labels
    lightness = lightness[track_id % len(lightness)]
    red, green, blue = (round(255 * x) for x in colorsys.hls_to_rgb(hue, lightness, 0.85))
    return f"#{red:02x}{green:02x}{blue:02x}"


def save(figure: Figure, path: str | Path, dpi: int = 130) -> Path:
    """Writes the figure in the format of the suffix (PNG, PDF, SVG), atomically."""
    path = Path(path)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi)
    return path


def birds_eye_axes(panel, x_range=(0.0, 72.0), y_range=(-30.0, 30.0)) -> None:
    """Sets the axes: x forward to the right, y left upwards, metres, equal scale."""
    panel.set_aspect("equal")
    panel.set_xlim(*x_range)
    panel.set_ylim(*y_range)
    panel.set_xlabel("x forward (m)", fontsize=TEXT)
    panel.set_ylabel("y left (m)", fontsize=TEXT)


def label(panel, *place_and_text, color, **style) -> Text:
    """Draws text with a white rim, legible over points and lines; returns it."""
    rim = [withStroke(linewidth=2.5, foreground="white")]
    return panel.text(
        *place_and_text, color=color, fontsize=TEXT, clip_on=True, path_effects=rim, **style
    )


def legend_below(figure: Figure, handles: list) -> None:
    """Draws one legend below all panels."""
    figure.legend(
        handles=handles, loc="outside lower center", ncols=2, fontsize=TEXT, frameon=False
    )


def box_handle(color: str, text: str, **style) -> Patch:
    """The entry of boxes in a legend."""
    return Patch(facecolor="none", edgecolor=color, label=text, **style)


def line_handle(color: str, text: str, **style) -> Line2D:
    """The entry of lines or markers in a legend."""
    return Line2D([], [], color=color, label=text, **style)


def draw_points(panel, points: np.ndarray, color=POINTS, size: float = 0.4, **style) -> Line2D:
    """Draws points (n, >=2) from above."""
    x, y = points[:, 0], points[:, 1]
    return panel.plot(x, y, ".", color=color, markersize=size, zorder=1, **style)[0]


def outlines(boxes: np.ndarray) -> np.ndarray:
    """(M, 7) -> (M, 6, 2): outline from above, then a stroke to the middle of the front."""
    corners = box_corners(boxes)[:, :4, :2]
    front = corners[:, [0, 3]].mean(axis=1)
    return np.concatenate([corners[:, [3, 2, 1, 0, 3]], front[:, None]], axis=1)


def draw_boxes(panel, boxes: np.ndarray, color, **style) -> LineCollection:
    """Draws boxes (M, 7) from above; `color` is one colour or M of them."""
    lines = LineCollection(list(outlines(boxes)), colors=color, **style)
    panel.add_collection(lines)
    return lines


def draw_trails(panel, trails: dict[int, np.ndarray], color, **style) -> LineCollection:
    """Draws lines through centres (k, 3) from above; `color` may be a function of the id."""
    colors = [color(i) for i in trails] if callable(color) else color
    lines = LineCollection([trail[:, :2] for trail in trails.values()], colors=colors, **style)
    panel.add_collection(lines)
    return lines
