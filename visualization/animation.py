"""A sequence from above with ids, as a GIF by Pillow."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from PIL import Image

from common.files import atomic_path
from common.notes import note
from visualization.birds_eye import BirdsEye
from visualization.clip import Clip
from visualization.drawing import ON_WHITE, TRUTH, id_color

WIDTH, DPI = 6.4, 100  # inches, pixels each
GREYS, TINTS = 31, 8  # of the palette, the latter of each colour
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
    view = BirdsEye(clip, clip.frames[:count], id_color, WIDTH)
    view.figure.set_dpi(DPI)
    canvas, images, colors = FigureCanvasAgg(view.figure), [], palette()
    for t in clip.frames[:count]:
        view.draw(t, f"{title}, frame {t}")
        images.append(_image(canvas, colors))
        each_frame()
    with atomic_path(path) as temporary:
        images[0].save(
            temporary, save_all=True, append_images=images[1:], duration=FRAME_MS, loop=0
        )
    return Path(path)


def palette() -> Image.Image:
    """An image whose palette is greys, and tints of the colours of ids and labels."""
    pure = 255 * np.array([to_rgb(color) for color in (TRUTH, *ON_WHITE)])
    white = np.linspace(0, 1, TINTS, endpoint=False)[:, None, None]
    tints = 255 * white + (1 - white) * pure
    greys = np.repeat(np.linspace(0, 255, GREYS), 3).reshape(-1, 3)
    image = Image.new("P", (1, 1))
    image.putpalette(np.concatenate([greys, *tints]).round().astype(np.uint8).tobytes())
    return image


def _image(canvas: FigureCanvasAgg, colors: Image.Image) -> Image.Image:
    """The image on the canvas, in the palette of `colors`."""
    canvas.draw()
    canvas.figure.set_layout_engine("none")  # the layout is computed once, since it is slow
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    image = Image.fromarray(np.ascontiguousarray(pixels))
    return image.quantize(palette=colors, dither=Image.Dither.NONE)
