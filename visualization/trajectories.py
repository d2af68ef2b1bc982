"""The paper's Fig. 6: trajectories in 3-D with boxes, coloured by id."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from kitti.boxes import box_corners
from kitti.objects import Objects
from visualization.clip import Clip
from visualization.drawing import (
    EDGES,
    TEXT,
    box_handle,
    id_color,
    label,
    legend_below,
    line_handle,
)

SPAN = 60  # frames
BOX_EVERY = 20  # frames between two drawn boxes of a track
MAX_POINTS = 6000  # of the scan behind the tracks
X_RANGE, Y_RANGE = (0.0, 70.0), (-25.0, 25.0)  # metres shown
ID_SIZE = (10.0, 13.0)  # points, of a digit
TURNS = np.pi * np.linspace(0.5, 2.5, 16, endpoint=False)  # from straight up


def trajectories(clips: Sequence[Clip], titles: Sequence[str]) -> Figure:
    """A row per clip (such as displacement 0 and 2 m): its tracks over the last `SPAN` frames.

    Positions are in the sensor's frame of each time, as in the paper.
    """
    figure = Figure(figsize=(7.6, 5.6 * len(clips) + 0.7), layout="constrained")
    shown = []
    for row, (clip, title) in enumerate(zip(clips, titles, strict=True)):
        panel = figure.add_subplot(len(clips), 1, row + 1, projection="3d")
        last = clip.frames[-1]
        frame = clip.results.frame
        rows = (frame > last - SPAN) & (frame <= last) & _inside(clip.results.boxes)
        found = clip.results[rows]
        tracks = [found[found.track_id == i] for i in np.unique(found.track_id)]
        scan = clip.scan(last)
        _draw_scan(panel, scan[_inside(scan)])
        for track in tracks:
            _draw_track(panel, track)
        _axes(panel)
        panel.set_title(f"{title} ({len(tracks)} ids)", fontsize=TEXT + 1)
        shown.append((panel, tracks))
    legend_below(figure, _handles(), "positions relative to the scanner, coloured by id")
    figure.draw_without_rendering()  # now the panels have their places
    for panel, tracks in shown:
        _write_ids(panel, tracks)
    return figure


def spread(anchors: np.ndarray, sizes: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """(n, 2) centres of n words, each near its anchor, on no other word and on nothing drawn.

    anchors, sizes: (n, 2); drawn: (m, 2) points; all in one unit.
    """
    taken, extents = drawn, np.zeros_like(drawn)
    ways = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1)
    for anchor, size in zip(anchors, sizes, strict=True):
        radii = size[1] * np.arange(1, 20, 0.5)
        tried = anchor + (radii[:, None, None] * ways).reshape(-1, 2)
        free = (abs(tried[:, None] - taken) >= (size + extents) / 2).any(axis=2).all(axis=1)
        taken = np.concatenate([taken, tried[[np.argmax(free)]]])
        extents = np.concatenate([extents, size[None]])
    return taken[len(drawn) :]


def _inside(points: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, >=2) in the shown range, since mplot3d does not clip."""
    x, y = points[:, 0], points[:, 1]
    return (x >= X_RANGE[0]) & (x <= X_RANGE[1]) & (y >= Y_RANGE[0]) & (y <= Y_RANGE[1])


def _draw_scan(panel, points: np.ndarray) -> None:
    step = max(1, len(points) // MAX_POINTS)
    x, y, z = points[::step, :3].T
    panel.plot(x, y, z, ".", color="0.75", markersize=0.4)


def _draw_track(panel, track: Objects) -> None:
    color = id_color(int(track.track_id[0]))
    panel.plot(*track.boxes[:, :3].T, color=color, linewidth=1.3)
    strokes = [corners[list(edge)] for corners in _corners(track) for edge in EDGES]
    panel.add_collection3d(Line3DCollection(strokes, colors=color, linewidths=0.8))


def _corners(track: Objects) -> np.ndarray:
    """(k, 8, 3) of the boxes that are drawn, the last one and others before it."""
    return box_corners(track.boxes[(track.frame - track.frame[-1]) % BOX_EVERY == 0])


def _write_ids(panel, tracks: list[Objects]) -> None:
    """Writes each id near the last box of its track, with a line to it."""

    def project(parts: list[np.ndarray]) -> np.ndarray:
        """(n, 2) in the panel's plane."""
        points = np.concatenate([np.zeros((0, 3)), *(part.reshape(-1, 3) for part in parts)])
        return np.stack(proj_transform(*points.T, panel.get_proj())[:2], axis=1)

    def printed(places: np.ndarray) -> np.ndarray:
        """(n, 2) in points, as letters are measured."""
        return panel.transData.transform(places) * 72 / panel.figure.dpi

    centres = [track.boxes[:, :3] for track in tracks]
    last = project([way[-1] for way in centres])
    drawn = project([*centres, *(_corners(track) for track in tracks)])
    ids = [str(track.track_id[0]) for track in tracks]
    sizes = np.array([(ID_SIZE[0] * len(text), ID_SIZE[1]) for text in ids]).reshape(-1, 2)
    offsets = spread(printed(last), sizes, printed(drawn)) - printed(last)
    style = {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 10}
    for text, place, offset in zip(ids, last, offsets, strict=True):
        color = id_color(int(text))
        line = {"arrowstyle": "-", "color": color, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
        label(panel, text, place, color, xytext=offset, arrowprops=line, **style)


def _axes(panel) -> None:
    panel.set_xlim(*X_RANGE)
    panel.set_ylim(*Y_RANGE)
    panel.set_zlim(-3, 6)
    panel.set_box_aspect((70, 50, 9), zoom=1.25)
    panel.view_init(elev=48, azim=-125)
    panel.set_xlabel("x forward (m)", fontsize=TEXT)
    panel.set_ylabel("y left (m)", fontsize=TEXT)
    panel.set_zticks([])


def _handles() -> list:
    colors = [id_color(i) for i in range(3)]
    return [
        tuple(line_handle(color, f"tracks over the last {SPAN} frames") for color in colors),
        tuple(box_handle(color, f"their boxes every {BOX_EVERY} frames") for color in colors),
    ]
