"""A sequence from above with ids, as a GIF by Pillow."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from common.files import atomic_path
from common.notes import note
from visualization.birds_eye import BirdsEye
from visualization.clip import Clip
from visualization.drawing import id_color

SIZE = (6.4, 6.1)  # inches, 100 pixels each
TRAIL = 20  # frames
COLORS = 96  # of the GIF's palette
FRAME_MS = 100  # one turn of the scanner
MAX_FRAMES = 100  # by default


def animated_frames(num_frames: int, max_frames: int) -> int:
    """The number of frames in an animation of at most `max_frames` (0: all)."""
    return min(num_frames, max_frames or num_frames)


def animate(
    clip: Clip,
    path: str | Path,
    title: str = "",
    max_frames: int = MAX_FRAMES,
    each_frame: Callable[[], None] = lambda: None,
) -> Path:
    """Writes the first `max_frames` frames (0: all) as an endless GIF; notes omitted frames."""
    count = animated_frames(len(clip.frames), max_frames)
    if count < len(clip.frames):
        note(f"{path}: the first {count} of {len(clip.frames)} frames; --animation_frames 0: all")
    title = title or f"sequence {clip.name}"
    view = BirdsEye(clip, id_color, TRAIL, SIZE)
    view.figure.set_dpi(100)
    canvas, images = FigureCanvasAgg(view.figure), []
    for t in clip.frames[:count]:
        view.draw(t, f"{title}, frame {t}")
        images.append(_image(canvas))
        each_frame()
    with atomic_path(path) as temporary:
        images[0].save(
            temporary, save_all=True, append_images=images[1:], duration=FRAME_MS, loop=0
        )
    return Path(path)


def _image(canvas: FigureCanvasAgg) -> Image.Image:
    """The image on the canvas, with a small palette."""
    canvas.draw()
    canvas.figure.set_layout_engine("none")  # the layout is computed once, since it is slow
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    return Image.fromarray(np.ascontiguousarray(pixels)).quantize(
        COLORS, method=Image.Quantize.MAXCOVERAGE
    )
