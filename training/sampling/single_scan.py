"""Pairs of frames made from one scan, to train the tracker on scans without a neighbour."""

import numpy as np

from kitti.boxes import transform_boxes
from training.sampling.frames import LabelledFrame

MAX_FORWARD = 2.0
"""Metres driven between the frames: 72 km/h at 10 Hz."""
MAX_YAW = np.deg2rad(3.0)
"""Radians turned between the frames."""


def split_scan(
    frame: LabelledFrame, rng: np.random.Generator
) -> tuple[LabelledFrame, LabelledFrame]:
    """A frame -> frames t-1 and t: random halves of its points, the second after ego motion.

    Between the frames the vehicle drives straight on by [0, `MAX_FORWARD`] and then turns by up to
    `MAX_YAW`, both uniform, in the plane; every object stands still. `ground_model` of both is that
    of the frame.
    """
    rows = rng.permutation(len(frame.points))
    halves = [np.sort(half) for half in np.array_split(rows, 2)]
    first, second = (frame.only(half) for half in halves)
    motion = ego_motion(rng.uniform(0.0, MAX_FORWARD), rng.uniform(-MAX_YAW, MAX_YAW))
    moved = second.points @ motion[:3, :3].T + motion[:3, 3]
    return first, second._replace(
        points=moved.astype(np.float32),
        boxes=transform_boxes(frame.boxes, motion),
        other_boxes=transform_boxes(frame.other_boxes, motion),
    )


def ego_motion(forward: float, yaw: float) -> np.ndarray:
    """(4, 4): level frame -> level frame after driving `forward` metres and turning by `yaw`."""
    c, s = np.cos(yaw), np.sin(yaw)
    motion = np.eye(4)
    motion[:2, :2] = [[c, s], [-s, c]]
    motion[:2, 3] = motion[:2, 0] * -forward
    return motion
