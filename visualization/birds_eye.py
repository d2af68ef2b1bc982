"""The paper's Fig. 1: truth (green, dotted) against prediction (blue, solid) from above."""

from __future__ import annotations

from matplotlib.figure import Figure

from visualization.clip import Clip
from visualization.drawing import (
    FOUND,
    TEXT,
    TRUTH,
    birds_eye_axes,
    box_handle,
    draw_boxes,
    draw_points,
    draw_trails,
    label,
    legend_below,
    line_handle,
)

TRAIL = 30  # frames: 3 s


def birds_eye(clip: Clip, t: int, title: str = "") -> Figure:
    """Frame t with boxes and the way they came in the last 3 s.

    Where poses are known the sensor's own motion is taken out, so that parked cars stand still.
    """
    figure = Figure(figsize=(7.2, 6.9), layout="constrained")
    panel = figure.subplots()
    draw_points(panel, clip.scan(t))
    truth, found = clip.truth.at(t), clip.results.at(t)
    draw_boxes(panel, truth.boxes, TRUTH, linewidth=2.2, zorder=2)
    draw_trails(
        panel, clip.trails(clip.truth, t, TRAIL), TRUTH, linestyle=":", linewidth=2.2, zorder=2
    )
    draw_boxes(panel, found.boxes, FOUND, linewidth=1.2, zorder=3)
    draw_trails(panel, clip.trails(clip.results, t, TRAIL), FOUND, linewidth=1.0, zorder=3)
    for track_id, box in zip(found.track_id.tolist(), found.boxes, strict=True):
        label(panel, box[0], box[1] + 1.6, str(track_id), color=FOUND, zorder=4)
    birds_eye_axes(panel)
    handles = _handles(FOUND, "PointTrackNet, with ids", "-", 1.2)
    if len(clip.truth):
        handles += _handles(TRUTH, "truth", ":", 2.2)
    legend_below(figure, handles)
    panel.set_title(title or f"sequence {clip.name}, frame {t}", fontsize=TEXT + 1)
    return figure


def _handles(color: str, name: str, linestyle: str, width: float) -> list:
    way = "its way in the last 3 s"
    return [
        box_handle(color, name, linewidth=width),
        line_handle(color, way, linestyle=linestyle, linewidth=width),
    ]
