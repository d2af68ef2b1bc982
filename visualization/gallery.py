"""All pictures of the demo with their frames, files and captions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.errors import InputError
from common.progress import Progress
from kitti.objects import Objects
from visualization.animation import MAX_FRAMES, animate, animated_frames
from visualization.association import association
from visualization.birds_eye import birds_eye
from visualization.clip import Clip
from visualization.drawing import save
from visualization.network_scene import network_data
from visualization.sampling import sampling, share_in_boxes
from visualization.scene import scene_data
from visualization.scene_page import write_scene
from visualization.scene_points import FOREGROUND, ScenePoints
from visualization.trajectories import trajectories


def sequence_title(name: str, object_shift: float, results: str = "") -> str:
    """The title of a sequence, with its object shift in metres and the results' name, if any."""
    shift = f"objects shifted by up to {object_shift:g} m" if object_shift else ""
    return ", ".join(part for part in (f"sequence {name}", results, shift) if part)


class Picture(NamedTuple):
    """A file and its caption."""

    path: Path
    caption: str


PICTURES = {
    "birds_eye.png": "Bird's-eye view (the paper's Fig. 1): true boxes in green, trails dotted; "
    "PointTrackNet's boxes in blue with ids, trails solid.",
    "sampling.png": "Sampling (Fig. 3): points that the tracker's layers keep after the "
    "probability filter (green) and by farthest-point sampling alone (red).",
    "association.png": "Association head (Fig. 4): the neighbours in the next frame (solid blue) "
    "of one point (solid red).",
    "trajectories.png": "Trajectories in 3-D over 60 frames (Fig. 6), coloured by id, at each "
    "displacement; the grey points are the last scan.",
    "animation.gif": "The sequence from above, coloured by id; true boxes are dotted.",
}


def pictures(folder: str | Path) -> list[Picture]:
    """The files that `draw_tracks` and `draw_network` write, in the page's order."""
    return [Picture(Path(folder) / name, caption) for name, caption in PICTURES.items()]


def draw_tracks(
    clips: Sequence[Clip], titles: Sequence[str], folder: Path, max_frames: int = MAX_FRAMES
) -> None:
    """Draws Fig. 1, Fig. 6 and the animation.

    clips: of one sequence, one per displacement, the first one undisplaced; titles: of the clips;
    max_frames: as in `animate`.
    """
    first = clips[0]
    frames = animated_frames(len(first.frames), max_frames)
    with Progress(frames + 1 + len(clips), "pictures of tracks", "pictures") as bar:
        t = first.busiest_frame()
        save(birds_eye(first, t, f"{titles[0]}, frame {t}"), folder / "birds_eye.png")
        bar.update()
        save(trajectories(clips, titles), folder / "trajectories.png", dpi=110)
        bar.update(len(clips))
        animate(first, folder / "animation.gif", titles[0], max_frames, bar.update)


def draw_unlabelled(
    name: str,
    results: Objects,
    points: Callable[[int], np.ndarray | None],
    frames: range,
    folder: Path,
    max_frames: int = MAX_FRAMES,
    seen: ScenePoints | None = None,
) -> list[Path]:
    """Draws Fig. 1 and Fig. 6 at the last frame, animation and scene of all `frames`.

    results, points, frames: as in `Clip`; max_frames: as in `animate`; seen: the points of the
    scene, by default those of the pictures. Returns the files written.
    """
    clip = Clip(name, frames, points, results, Objects.empty())
    files = ("birds_eye.png", "trajectories.png", "animation.gif", "scene.html")
    paths = [folder / file for file in files]
    with Progress(animated_frames(len(frames), max_frames) + 3, "pictures", "pictures") as bar:
        save(birds_eye(clip, frames[-1], f"{name}, frame {frames[-1]}"), paths[0])
        bar.update()
        save(trajectories([clip], [name]), paths[1], dpi=110)
        bar.update()
        animate(clip, paths[2], name, max_frames, bar.update)
        draw_scene(clip, {"PointTrackNet": results}, name, paths[3], points=seen)
        bar.update()
    return paths


def draw_scene(
    clip: Clip,
    trackers: Mapping[str, Objects],
    title: str,
    path: Path,
    weights: Path | None = None,
    **options: Any,
) -> Path:
    """Writes the drive in 3-D as HTML; `options` are those of `visualization.scene.scene_data`.

    weights: of the detector whose foreground probability colours the points; None for intensity.
    """
    if weights is not None:
        from visualization.views import foreground_points  # TensorFlow only where it is needed

        clip = replace(clip, points=foreground_points(clip, weights))
        options["shading"] = FOREGROUND
    return write_scene(path, title, scene_data(clip, trackers, **options))


def draw_network(
    clip: Clip,
    weights: Path,
    title: str,
    sampling_path: Path,
    association_path: Path,
    frame: int | None = None,
    scene_path: Path | None = None,
) -> dict[str, float]:
    """Draws Fig. 3 and Fig. 4 at a frame, by default the busiest, and both as a 3-D scene.

    Returns shares of sampled points that lie on vehicles, by layer and kind of sampling. Raises
    InputError where the frame or the one before it has no scan.
    """
    from models.inference import StreamingNetwork  # TensorFlow only where it is needed
    from models.weights import load_networks
    from visualization.views import network_frame

    t = _frame_with_scans(clip) if frame is None else _checked_frame(clip, frame)
    with Progress(3, "pictures of the network", "steps") as bar:
        network = StreamingNetwork(*load_networks(weights))
        bar.update()
        before, now = clip.truth.at(t - 1).boxes, clip.truth.at(t).boxes
        previous, current = (network.detect(clip.scan(i), i) for i in (t - 1, t))
        seen = network_frame(network, previous, current, before, t)
        bar.update()
        figure = sampling(seen.samplings, current.sampled, now, f"{title}, frame {t}")
        save(figure, sampling_path)
        titled = f"{title}, frames {t - 1} and {t}"
        save(association(seen.neighborhood, before, now, titled), association_path)
        if scene_path is not None:
            write_scene(scene_path, titled, network_data(clip, seen))
        bar.update()
    shares = {}
    for layer, filtered, plain in zip(*seen.samplings, strict=True):
        shares[f"{layer} filtered"] = share_in_boxes(filtered, now)
        shares[f"{layer} plain"] = share_in_boxes(plain, now)
    return shares


def _checked_frame(clip: Clip, t: int) -> int:
    if t not in clip.frames[1:] or not len(clip.scan(t)) or not len(clip.scan(t - 1)):
        raise InputError(f"frame {t}: expected a scan there and in the frame before")
    return t


def _frame_with_scans(clip: Clip) -> int:
    """The busiest frame, or the nearest one that has a scan and one before it."""
    busiest = clip.busiest_frame()
    for t in sorted(clip.frames[1:], key=lambda t: abs(t - busiest)):
        if len(clip.scan(t)) and len(clip.scan(t - 1)):
            return t
    raise InputError(f"sequence {clip.name} has no two adjacent scans")
