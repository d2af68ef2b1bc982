"""The paper's Fig. 3: sampling after the probability filter against plain farthest points."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from kitti.boxes import points_in_boxes
from visualization.drawing import (
    FOUND,
    TEXT,
    birds_eye_axes,
    box_handle,
    draw_boxes,
    draw_points,
    legend_below,
    line_handle,
)

FILTERED_COLOR, PLAIN_COLOR = "tab:green", "tab:red"
X_RANGE, Y_RANGE = (0.0, 66.0), (-22.0, 22.0)  # metres shown


class Samplings(NamedTuple):
    """Points that layers of the tracker sample, with and without the filter before them."""

    layers: tuple[str, ...]  # names, such as "TRA_SA1"
    filtered: tuple[np.ndarray, ...]  # per layer (M, 3) level frame
    plain: tuple[np.ndarray, ...]  # per layer (M, 3) level frame


def sampling(samplings: Samplings, points: np.ndarray, boxes: np.ndarray, title="") -> Figure:
    """A panel per layer, one below the other: green after the filter, red without it.

    A point that both keep is green with a red rim. The true boxes are blue.

    points: (n, >=3) the scan, behind both; boxes: (M, 7), level frame.
    """
    count = len(samplings.layers)
    figure = Figure(figsize=(7.2, 5.2 * count + 0.6), layout="constrained")
    panels = figure.subplots(count, 1, squeeze=False)[:, 0]
    for panel, name, filtered, plain in zip(panels, *samplings, strict=True):
        draw_points(panel, points, color="0.82", size=0.3)
        size = 2.6 if len(plain) > 200 else 9.0
        draw_points(panel, plain, PLAIN_COLOR, 1.5 * size)
        draw_points(panel, filtered, FILTERED_COLOR, size)
        draw_boxes(panel, boxes, FOUND, linewidth=1.4, zorder=3)
        birds_eye_axes(panel, X_RANGE, Y_RANGE)
        panel.set_title(f"{name}: {len(plain)} points", fontsize=TEXT)
    dots = {"linestyle": "none", "marker": "."}
    handles = [
        line_handle(PLAIN_COLOR, "farthest points of the whole scan", markersize=14, **dots),
        line_handle(FILTERED_COLOR, "after the probability filter", markersize=10, **dots),
    ]
    if len(boxes):
        handles.append(box_handle(FOUND, "true vehicles", linewidth=1.4))
    legend_below(figure, handles)
    figure.suptitle(title, fontsize=TEXT + 1)
    return figure


def share_in_boxes(points: np.ndarray, boxes: np.ndarray) -> float:
    """Share of points (n, >=3) that lie in one of the boxes (M, 7)."""
    return float((points_in_boxes(points, boxes) >= 0).mean()) if len(points) else 0.0
