"""The paper's Fig. 6: trajectories in 3-D with boxes, one colour per id."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from kitti.boxes import box_corners
from kitti.objects import Objects
from visualization.clip import Clip
from visualization.drawing import EDGES, TEXT, id_color, label

SPAN = 60  # frames: 6 s
BOX_EVERY = 10  # frames between two drawn boxes of a track
MAX_POINTS = 6000  # of the scan behind the tracks
X_RANGE, Y_RANGE = (0.0, 70.0), (-25.0, 25.0)  # metres shown


def trajectories(clips: Sequence[Clip], titles: Sequence[str]) -> Figure:
    """A row per clip (such as displacement 0 and 2 m): its tracks over the last `SPAN` frames.

    Positions are in the sensor's frame of each time, as in the paper.
    """
    figure = Figure(figsize=(7.6, 5.6 * len(clips)), layout="constrained")
    for row, (clip, title) in enumerate(zip(clips, titles, strict=True)):
        panel = figure.add_subplot(len(clips), 1, row + 1, projection="3d")
        last = clip.frames[-1]
        frame = clip.results.frame
        shown = (frame > last - SPAN) & (frame <= last) & _inside(clip.results.boxes)
        tracks = clip.results[shown]
        scan = clip.scan(last)
        _draw_scan(panel, scan[_inside(scan)])
        for track_id in np.unique(tracks.track_id):
            _draw_track(panel, tracks[tracks.track_id == track_id], id_color(int(track_id)))
        _axes(panel)
        panel.set_title(f"{title} ({len(np.unique(tracks.track_id))} ids)", fontsize=TEXT + 1)
    return figure


def _inside(points: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, >=2) in the shown range, since mplot3d does not clip."""
    x, y = points[:, 0], points[:, 1]
    return (x >= X_RANGE[0]) & (x <= X_RANGE[1]) & (y >= Y_RANGE[0]) & (y <= Y_RANGE[1])


def _draw_scan(panel, points: np.ndarray) -> None:
    step = max(1, len(points) // MAX_POINTS)
    x, y, z = points[::step, :3].T
    panel.plot(x, y, z, ".", color="0.75", markersize=0.4)


def _draw_track(panel, track: Objects, color: str) -> None:
    panel.plot(*track.boxes[:, :3].T, color=color, linewidth=1.3)
    shown = track[(track.frame - track.frame[-1]) % BOX_EVERY == 0]
    strokes = [corners[list(edge)] for corners in box_corners(shown.boxes) for edge in EDGES]
    panel.add_collection3d(Line3DCollection(strokes, colors=color, linewidths=0.8))
    x, y, z = track.boxes[-1, :3]
    label(panel, x, y, z + 2, str(track.track_id[0]), color=color, zorder=10)


def _axes(panel) -> None:
    panel.set_xlim(*X_RANGE)
    panel.set_ylim(*Y_RANGE)
    panel.set_zlim(-3, 6)
    panel.set_box_aspect((70, 50, 9), zoom=1.25)
    panel.view_init(elev=48, azim=-125)
    panel.set_xlabel("x forward (m)", fontsize=TEXT)
    panel.set_ylabel("y left (m)", fontsize=TEXT)
    panel.set_zticks([])
