"""A frame from above: truth (green, dotted) against prediction (solid); the paper's Fig. 1."""

from collections.abc import Callable, Sequence

import numpy as np
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
    outlines,
)

TRAIL = 30  # frames, length of a trail
WIDTH = 7.2  # inches
STEP = 5.0  # metres, to whose multiples the view is rounded
ID_ROOM = (0.0, 3.0)  # metres along x and y above a box
BULK, MARGIN = (1, 99), 1.0  # percentiles of the points in view, and metres around them
SCANS = 10  # of a clip whose points decide on the view


class BirdsEye:
    """A figure whose contents change from frame to frame.

    Where poses are known the trails exclude the sensor's motion: parked cars stand still.

    Args:
        clip: scans, tracks and labels.
        frames: that will be drawn, all in the same view.
        color: of the tracks: one, or a function of the id.
        width: of the figure in inches.
    """

    def __init__(
        self,
        clip: Clip,
        frames: Sequence[int],
        color: str | Callable[[int], str] = FOUND,
        width: float = WIDTH,
    ):
        self.clip, self.color = clip, color
        x_range, y_range = view = view_of(clip, frames)
        wide, high = np.ptp(view, axis=1)
        height = 1.7 + (width - 0.8) * min(high / wide, 1.0)  # title, legend; the panel
        self.figure = Figure(figsize=(width, height), layout="constrained")
        self.panel = self.figure.subplots()
        birds_eye_axes(self.panel, x_range, y_range)
        self._drawn = []  # of one frame
        reference = "scanner" if clip.poses is None else "ground"
        title = f"trails over the last {TRAIL} frames, relative to the {reference}"
        legend_below(self.figure, self._handles(), title)

    def draw(self, t: int, title: str = "") -> Figure:
        """Replaces the contents by frame t; returns the figure."""
        for artist in self._drawn:
            artist.remove()
        clip, panel = self.clip, self.panel
        truth, found = clip.truth.at(t), clip.results.at(t)
        ids = found.track_id.tolist()
        colors = [self._of(i) for i in ids]
        trails = [clip.trails(objects, t, TRAIL) for objects in (clip.truth, clip.results)]
        self._drawn = [
            draw_points(panel, clip.scan(t)),
            draw_boxes(panel, truth.boxes, TRUTH, linewidth=2.2, zorder=2),
            draw_trails(panel, trails[0], TRUTH, linestyle=":", linewidth=2.2, zorder=2),
            draw_boxes(panel, found.boxes, colors, linewidth=1.2, zorder=3),
            draw_trails(panel, trails[1], self._of, linewidth=1.0, zorder=3),
            *(
                label(panel, str(i), (box[0], box[1] + 1.6), color, clip_on=True, zorder=4)
                for i, box, color in zip(ids, found.boxes, colors, strict=True)
            ),
        ]
        panel.set_title(title or f"sequence {clip.name}, frame {t}", fontsize=TEXT + 1)
        return self.figure

    def _of(self, track_id: int) -> str:
        return self.color(track_id) if callable(self.color) else self.color

    def _handles(self) -> list:
        several = callable(self.color)
        name = "tracks, coloured by id" if several else "tracks, with ids"
        handles = []
        if len(self.clip.results) or not len(self.clip.truth):
            colors = [self._of(i) for i in range(3 if several else 1)]
            handles += _handles(colors, name, linestyle="-", linewidth=1.2)
        if len(self.clip.truth):
            handles += _handles([TRUTH], "truth", linestyle=":", linewidth=2.2)
        return handles


def birds_eye(clip: Clip, t: int, title: str = "") -> Figure:
    """Frame t with boxes and their trails of the last `TRAIL` frames."""
    return BirdsEye(clip, [t]).draw(t, title)


def view_of(clip: Clip, frames: Sequence[int]) -> np.ndarray:
    """(2, 2) least and greatest x and y: the scanner, all boxes and the bulk of the points."""
    boxes = [o[np.isin(o.frame, frames)].boxes for o in (clip.truth, clip.results)]
    corners = outlines(np.concatenate(boxes)).reshape(-1, 2)
    corners = corners[np.isfinite(corners).all(axis=1)]
    some = frames[:: max(1, len(frames) // SCANS)]
    scanner = np.zeros((1, 2))
    points = np.concatenate([scanner, *(clip.scan(t)[:, :2] for t in some)])
    ends = np.percentile(points, BULK, axis=0) + MARGIN * np.array([[-1], [1]])
    shown = np.concatenate([scanner, ends, corners, corners + ID_ROOM])
    return STEP * np.stack([np.floor(shown.min(0) / STEP), np.ceil(shown.max(0) / STEP)], axis=1)


def _handles(colors: Sequence[str], name: str, linewidth: float, linestyle: str) -> list[tuple]:
    boxes = (box_handle(color, name, linewidth=linewidth) for color in colors)
    style = {"linestyle": linestyle, "linewidth": linewidth}
    return [tuple(boxes), tuple(line_handle(color, "their trails", **style) for color in colors)]
