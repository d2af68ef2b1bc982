"""Colours, axes and boxes that all pictures share."""

from pathlib import Path

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from common.files import atomic_path
from kitti.boxes import box_corners

TRUTH, FOUND, POINTS = "tab:green", "tab:blue", "0.6"
TEXT = 11  # points, in figures of about 7 inches: readable where a picture is as wide as a phone
ON_WHITE = (
    "#ff4411", "#440066", "#aa5588", "#1122ff", "#ff22ff", "#dd9900", "#6600bb", "#8899ff",
    "#aa0000", "#005599", "#ff2299", "#11bbbb", "#880066", "#7755ff", "#aa6600", "#0000aa",
    "#dd88bb", "#660000", "#bb00cc", "#1188bb",
)  # fmt: skip
"""Colours of consecutive ids: next ones differ most, all from greys and the green of labels."""
ON_DARK = (
    "#aaddff", "#aa66aa", "#ccff00", "#ff8833", "#22bbff", "#ff55ff", "#aa7755", "#00ffdd",
    "#7766ff", "#ffaacc", "#00aa99", "#dd00aa", "#ccbb00", "#bb99ff", "#ee1111", "#bb00ff",
    "#ffdd99", "#1188cc", "#ff6699", "#779900",
)  # fmt: skip
"""The same for the dark background of the 3-D scene."""
EDGES = ((0, 1, 2, 3, 0, 4, 5, 6, 7, 4), (1, 5), (2, 6), (3, 7))
"""Strokes through the corners of a box (see `kitti.boxes.box_corners`)."""


def id_color(track_id: int, colors: tuple[str, ...] = ON_WHITE) -> str:
    """The colour of a track, #rrggbb; the colours repeat after twenty ids."""
    return colors[track_id % len(colors)]


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


def label(panel, text: str, place, color: str, **style) -> Annotation:
    """Draws text with a white rim at `place` (x, y), legible over points and lines; returns it."""
    rim = [withStroke(linewidth=2.5, foreground="white")]
    return panel.annotate(text, place, color=color, fontsize=TEXT, path_effects=rim, **style)


def legend_below(figure: Figure, handles: list, title: str | None = None) -> None:
    """Draws one legend below all panels; a tuple of handles is one entry, named by its first."""
    labels = [(h[0] if isinstance(h, tuple) else h).get_label() for h in handles]
    style = {"ncols": 2, "fontsize": TEXT, "title_fontsize": TEXT, "frameon": False}
    side_by_side = {tuple: HandlerTuple(ndivide=None, pad=0.3)}
    place = "outside lower center"
    figure.legend(handles, labels, loc=place, title=title, handler_map=side_by_side, **style)


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
