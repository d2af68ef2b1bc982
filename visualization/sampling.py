"""The paper's Fig. 3: sampling after the probability filter against plain farthest points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from kitti.boxes import points_in_boxes
from visualization.drawing import FOUND, birds_eye_axes, draw_boxes, draw_points

FILTERED_COLOR, PLAIN_COLOR = "tab:green", "tab:red"


class Samplings(NamedTuple):
    """Points that layers of the tracker sample, with and without the filter before them."""

    layers: tuple[str, ...]  # names, such as "TRA_SA1"
    filtered: tuple[np.ndarray, ...]  # per layer (M, 3) level frame
    plain: tuple[np.ndarray, ...]  # per layer (M, 3) level frame


def sampling(samplings: Samplings, points: np.ndarray, boxes: np.ndarray, title="") -> Figure:
    """A panel per layer: green after the filter, red without it, blue the true boxes.

    points: (n, >=3) the scan, behind both; boxes: (M, 7), level frame.
    """
    count = len(samplings.layers)
    figure = Figure(figsize=(7 * count, 6.4), layout="constrained")
    panels = figure.subplots(1, count, squeeze=False)[0]
    for panel, name, filtered, plain in zip(panels, *samplings, strict=True):
        draw_points(panel, points, color="0.82", size=0.3)
        size = 2.6 if len(plain) > 200 else 7.0
        draw_points(panel, plain, PLAIN_COLOR, size, label="farthest points of the whole scan")
        draw_points(panel, filtered, FILTERED_COLOR, size, label="after the probability filter")
        draw_boxes(panel, boxes, FOUND, linewidth=1.4, zorder=3)
        birds_eye_axes(panel)
        panel.set_title(f"{name}: {len(plain)} points")
    panels[0].legend(loc="upper left", markerscale=3)
    figure.suptitle(title)
    return figure


def share_in_boxes(points: np.ndarray, boxes: np.ndarray) -> float:
    """Share of points (n, >=3) that lie in one of the boxes (M, 7)."""
    return float((points_in_boxes(points, boxes) >= 0).mean()) if len(points) else 0.0
