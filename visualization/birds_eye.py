"""A frame from above: truth (green, dotted) against prediction (solid); the paper's Fig. 1."""

from collections.abc import Callable

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


class BirdsEye:
    """A figure whose contents change from frame to frame.

    Where poses are known the trails exclude the sensor's motion: parked cars stand still.

    Args:
        clip: scans, tracks and labels.
        color: of the tracks: one, or a function of the id.
        trail: length of a trail in frames.
        size: width and height in inches.
    """

    def __init__(
        self,
        clip: Clip,
        color: str | Callable[[int], str] = FOUND,
        trail: int = TRAIL,
        size: tuple[float, float] = (7.2, 6.9),
    ):
        self.clip, self.color, self.trail = clip, color, trail
        self.figure = Figure(figsize=size, layout="constrained")
        self.panel = self.figure.subplots()
        birds_eye_axes(self.panel)
        self._drawn = []  # of one frame
        legend_below(self.figure, self._handles())

    def draw(self, t: int, title: str = "") -> Figure:
        """Replaces the contents by frame t; returns the figure."""
        for artist in self._drawn:
            artist.remove()
        clip, panel = self.clip, self.panel
        truth, found = clip.truth.at(t), clip.results.at(t)
        ids = found.track_id.tolist()
        colors = [self._of(i) for i in ids]
        trails = [clip.trails(objects, t, self.trail) for objects in (clip.truth, clip.results)]
        self._drawn = [
            draw_points(panel, clip.scan(t)),
            draw_boxes(panel, truth.boxes, TRUTH, linewidth=2.2, zorder=2),
            draw_trails(panel, trails[0], TRUTH, linestyle=":", linewidth=2.2, zorder=2),
            draw_boxes(panel, found.boxes, colors, linewidth=1.2, zorder=3),
            draw_trails(panel, trails[1], self._of, linewidth=1.0, zorder=3),
            *(
                label(panel, box[0], box[1] + 1.6, str(i), color=color, zorder=4)
                for i, box, color in zip(ids, found.boxes, colors, strict=True)
            ),
        ]
        panel.set_title(title or f"sequence {clip.name}, frame {t}", fontsize=TEXT + 1)
        return self.figure

    def _of(self, track_id: int) -> str:
        return self.color(track_id) if callable(self.color) else self.color

    def _handles(self) -> list:
        one = not callable(self.color)
        color, name = (FOUND, "with ids") if one else ("0.2", "one colour per id")
        handles = []
        if len(self.clip.results) or not len(self.clip.truth):
            handles += _handles(color, f"tracks, {name}", self.trail, "-", 1.2)
        if len(self.clip.truth):
            handles += _handles(TRUTH, "truth", self.trail, ":", 2.2)
        return handles


def birds_eye(clip: Clip, t: int, title: str = "") -> Figure:
    """Frame t with boxes and their trails of the last 3 s."""
    return BirdsEye(clip).draw(t, title)


def _handles(color: str, name: str, trail: int, linestyle: str, width: float) -> list:
    text = f"its trail over the last {trail / 10:g} s"
    return [
        box_handle(color, name, linewidth=width),
        line_handle(color, text, linestyle=linestyle, linewidth=width),
    ]
