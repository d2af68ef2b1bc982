"""The drive as a recording of the Rerun viewer; needs the package rerun-sdk."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from common.errors import InputError
from common.files import atomic_path
from kitti.objects import Objects
from visualization.clip import Clip
from visualization.drawing import ON_DARK, id_color
from visualization.scene import PERIOD

GREEN = (70, 214, 110)


def load_rerun():
    """The module rerun; InputError where it is not installed."""
    try:
        import rerun
    except ImportError as error:
        raise InputError("--rerun needs the package rerun-sdk: pip install rerun-sdk") from error
    return rerun


def write_recording(path: str | Path, clip: Clip, trackers: Mapping[str, Objects]) -> Path:
    """Writes points, labels and tracks of every frame to a .rrd file, in the level frame.

    Where poses are known they are those of the entity `world/sensor`.
    """
    rr = load_rerun()
    with atomic_path(path) as temporary:
        recording = rr.RecordingStream("pointtracknet")
        recording.save(str(temporary))
        recording.log("world", rr.ViewCoordinates.FLU, static=True)
        for t in clip.frames:
            recording.set_time("frame", sequence=t)
            recording.set_time("time", duration=t * PERIOD)
            if clip.poses is not None:
                pose = clip.poses[t]
                place = rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
                recording.log("world/sensor", place)
            recording.log("world/sensor/points", rr.Points3D(clip.scan(t), radii=0.03))
            truth = clip.truth.at(t)
            recording.log("world/sensor/labels", _boxes(rr, truth, [GREEN] * len(truth)))
            for name, rows in trackers.items():
                now = rows.at(t)
                colors = [id_color(i, ON_DARK) for i in now.track_id.tolist()]
                now_colors = [tuple(bytes.fromhex(color[1:])) for color in colors]
                recording.log(f"world/sensor/{name}", _boxes(rr, now, now_colors))
        recording.flush()
        recording.disconnect()
    return Path(path)


def _boxes(rr, objects: Objects, colors: list[tuple[int, ...]]):
    """Boxes with their ids as a Rerun archetype."""
    boxes = objects.boxes
    half_turn = boxes[:, 6] / 2
    zero = np.zeros(len(boxes))
    return rr.Boxes3D(
        centers=boxes[:, :3],
        half_sizes=boxes[:, 3:6] / 2,
        quaternions=np.stack([zero, zero, np.sin(half_turn), np.cos(half_turn)], axis=1),
        colors=np.array(colors, np.uint8).reshape(-1, 3),
        labels=[f"{i}" for i in objects.track_id.tolist()],
    )
