"""The paper's Fig. 4: the association head's neighbourhood of one point in the next frame."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, ConnectionPatch

from visualization.drawing import (
    TEXT,
    birds_eye_axes,
    box_handle,
    draw_boxes,
    legend_below,
    line_handle,
)

PREVIOUS_COLOR, CURRENT_COLOR = "tab:red", "tab:blue"


class Neighborhood(NamedTuple):
    """Points that enter the association head, and the group of one of them."""

    previous: np.ndarray  # (512, 3) level frame, frame t-1
    current: np.ndarray  # (512, 3) level frame, frame t
    chosen: int  # row of `previous`
    group: np.ndarray  # (K,) rows of `current`
    radius: float  # metres, of the association


def association(view: Neighborhood, previous_boxes, current_boxes, title: str = "") -> Figure:
    """Frame A (t-1, red) and frame B (t, blue) from above; the chosen point and its group solid.

    previous_boxes, current_boxes: (M, 7) true boxes of the two frames, level frame, for context.
    """
    figure = Figure(figsize=(8.4, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    point, group = view.previous[view.chosen], view.current[np.unique(view.group)]
    reach = view.radius * 1.6
    for panel, points, boxes, color, name in (
        (left, view.previous, previous_boxes, PREVIOUS_COLOR, "frame A, t-1"),
        (right, view.current, current_boxes, CURRENT_COLOR, "frame B, t"),
    ):
        panel.scatter(
            points[:, 0], points[:, 1], s=26, facecolors="none", edgecolors=color, linewidths=0.9
        )
        draw_boxes(panel, boxes, "0.6", linewidth=1.0, zorder=0)
        birds_eye_axes(
            panel, (point[0] - reach, point[0] + reach), (point[1] - reach, point[1] + reach)
        )
        panel.set_title(name, fontsize=TEXT)
    right.set_ylabel("")  # as on the left; the lines to the group pass here
    left.scatter(*point[:2], s=60, color=PREVIOUS_COLOR)
    right.scatter(group[:, 0], group[:, 1], s=30, color=CURRENT_COLOR)
    right.scatter(*point[:2], s=60, color=PREVIOUS_COLOR, marker="x")
    right.add_patch(Circle(point[:2], view.radius, fill=False, linestyle="--", color="0.5"))
    for neighbor in group:
        ends = {"xyA": point[:2], "xyB": neighbor[:2], "axesA": left, "axesB": right}
        line = ConnectionPatch(coordsA="data", coordsB="data", **ends, linewidth=0.4, alpha=0.3)
        figure.add_artist(line)
    legend_below(figure, _handles(view))
    figure.suptitle(title, fontsize=TEXT + 1)
    return figure


def _handles(view: Neighborhood) -> list:
    dot, cross = ({"linestyle": "none", "marker": m, "markersize": 8} for m in "ox")
    ring = {**dot, "markersize": 5, "fillstyle": "none"}
    near = f"its nearest points, up to {len(view.group)} within {view.radius:g} m"
    return [
        line_handle(PREVIOUS_COLOR, "points of frame A", **ring),
        line_handle(PREVIOUS_COLOR, "one of them, $p_i^{t-1}$", **dot),
        line_handle(PREVIOUS_COLOR, "where it was, in frame B", **cross),
        line_handle(CURRENT_COLOR, "points of frame B", **ring),
        line_handle(CURRENT_COLOR, near, **dot),
        box_handle("0.6", "true vehicles"),
    ]
