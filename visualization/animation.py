"""A sequence from above with ids, as a GIF (Pillow, so no system package is needed)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from common.files import atomic_path
from common.notes import note
from visualization.clip import Clip
from visualization.drawing import (
    TEXT,
    TRUTH,
    birds_eye_axes,
    box_handle,
    draw_boxes,
    draw_trails,
    id_color,
    label,
    legend_below,
)

TRAIL = 20  # frames
COLORS = 96  # of the GIF's palette
FRAME_MS = 100  # the scanner's own pace


class Stage:
    """One figure whose contents change from frame to frame."""

    def __init__(self, clip: Clip, title: str):
        self.clip, self.title = clip, title
        self.figure = Figure(figsize=(6.4, 6.1), dpi=100, layout="constrained")
        self.canvas = FigureCanvasAgg(self.figure)
        self.panel = self.figure.subplots()
        birds_eye_axes(self.panel)
        (self.points,) = self.panel.plot([], [], ".", color="0.65", markersize=0.5, zorder=1)
        self.passing = []
        handles = [box_handle("0.2", "PointTrackNet, one colour per id", linewidth=1.8)]
        if len(clip.truth):
            handles.append(box_handle(TRUTH, "truth", linewidth=1.2, linestyle=":"))
        legend_below(self.figure, handles)

    def draw(self, t: int) -> None:
        """Shows frame t."""
        for artist in self.passing:
            artist.remove()
        clip, panel = self.clip, self.panel
        scan, found = clip.scan(t), clip.results.at(t)
        self.points.set_data(scan[:, 0], scan[:, 1])
        colors = [id_color(i) for i in found.track_id.tolist()]
        trails = clip.trails(clip.results, t, TRAIL)
        self.passing = [
            draw_boxes(panel, clip.truth.at(t).boxes, TRUTH, linewidth=1.2, linestyle=":"),
            draw_boxes(panel, found.boxes, colors, linewidth=1.8, zorder=3),
            draw_trails(panel, trails, id_color, linewidth=1.0, zorder=3),
            *(
                label(panel, box[0], box[1] + 1.6, str(i), color=color, zorder=4)
                for i, box, color in zip(found.track_id.tolist(), found.boxes, colors, strict=True)
            ),
        ]
        panel.set_title(f"{self.title}, frame {t}", fontsize=TEXT + 1)

    def image(self) -> Image.Image:
        """What is shown, with few colours."""
        self.canvas.draw()
        self.figure.set_layout_engine("none")  # laid out once; doing it again takes most time
        pixels = np.asarray(self.canvas.buffer_rgba())[..., :3]
        return Image.fromarray(np.ascontiguousarray(pixels)).quantize(
            COLORS, method=Image.Quantize.MAXCOVERAGE
        )


def animated_frames(num_frames: int, max_frames: int) -> int:
    """The number of frames in an animation of at most `max_frames` (0: all)."""
    return min(num_frames, max_frames or num_frames)


def animate(
    clip: Clip,
    path: str | Path,
    title: str = "",
    max_frames: int = 100,
    each_frame: Callable[[], None] = lambda: None,
) -> Path:
    """Writes the first `max_frames` frames (0: all) as an endless GIF; notes what is left out."""
    count = animated_frames(clip.num_frames, max_frames)
    if count < clip.num_frames:
        note(f"{path}: the first {count} of {clip.num_frames} frames; --animation_frames 0: all")
    stage = Stage(clip, title or f"sequence {clip.name}")
    images = []
    for t in range(count):
        stage.draw(t)
        images.append(stage.image())
        each_frame()
    with atomic_path(path) as temporary:
        images[0].save(
            temporary, save_all=True, append_images=images[1:], duration=FRAME_MS, loop=0
        )
    return Path(path)
