"""The paper's Fig. 1: truth (green, dotted) against prediction (blue, solid) from above."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from visualization.clip import Clip
from visualization.drawing import (
    FOUND,
    TRUTH,
    birds_eye_axes,
    draw_boxes,
    draw_points,
    draw_trails,
)

TRAIL = 30  # frames: 3 s


def birds_eye(clip: Clip, t: int, title: str = "") -> Figure:
    """Frame t with boxes and the way they came in the last 3 s.

    Where poses are known the sensor's own motion is taken out, so that parked cars stand still.
    """
    figure = Figure(figsize=(10, 7.6), layout="constrained")
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
        panel.annotate(
            str(track_id), (box[0], box[1] + 1.6), color=FOUND, fontsize=8, clip_on=True, zorder=4
        )
    birds_eye_axes(panel)
    handles = [Line2D([], [], color=FOUND, linewidth=1.2, label="PointTrackNet, with ids")]
    if len(clip.truth):
        handles.append(
            Line2D(
                [], [], color=TRUTH, linestyle=":", linewidth=2.2, label="truth, dotted: its way"
            )
        )
    panel.legend(handles=handles, loc="upper left")
    panel.set_title(title or f"sequence {clip.name}, frame {t}")
    return figure
