"""The points of a drive for the 3-D scene: thinned, rounded, shaded.

Letters: n points of a frame, C columns of a point.
"""

import base64
from typing import Any

import numpy as np

STEP = 0.01  # metres; resolution of a coordinate, stored in two bytes
POINTS_PER_FRAME = 8000
POINTS_IN_ALL = 1_500_000  # 9.3 bytes each in the file
FOREGROUND = "foreground probability"
DIM = (84, 94, 114)  # RGB of shading 0
BRIGHT = {"intensity": (236, 241, 250), FOREGROUND: (255, 150, 40)}
"""RGB of shading 1, by the meaning of the points' fourth column."""


class ScenePoints:
    """The points of a drive, added frame by frame, without storing whole scans.

    Args:
        num_frames: of the drive; long drives store fewer points of a frame.
        shading: meaning of the points' fourth column, a key of `BRIGHT`.
        per_frame: at most so many points of a frame are kept.
    """

    def __init__(
        self, num_frames: int, shading: str = "intensity", per_frame: int = POINTS_PER_FRAME
    ):
        self.limit = min(per_frame, max(1, POINTS_IN_ALL // num_frames))
        self.shading, self.most = shading, 0
        self.frames = [""] * num_frames

    def put(self, t: int, points: np.ndarray | None) -> None:
        """Stores points (n, 3 or 4), level frame, metres, of frame t; None for a missing scan."""
        if points is None:
            return
        self.most = max(self.most, len(points))
        points = thin(points, self.limit, t)
        if points.shape[1] == 3:
            self.shading = "one shade"
        elif self.shading == "intensity":  # most intensities are low: the square root spreads them
            points = np.column_stack([points[:, :3], np.sqrt(np.abs(points[:, 3]))])
        self.frames[t] = pack_points(points)

    def data(self) -> dict[str, Any]:
        """The frames and the colours of their shading, JSON-ready."""
        bright = BRIGHT.get(self.shading, BRIGHT["intensity"])
        colors = np.linspace(DIM, bright, 256).round().astype(int).tolist()
        return {"step": STEP, "frames": self.frames, "colors": colors, "shading": self.shading}

    def note(self) -> str:
        """A sentence on thinning, rounding and shading."""
        kept = f"all, up to {self.most}"
        if self.most > self.limit:
            kept = f"{self.limit} of up to {self.most}, drawn at random"
        shaded = "" if self.shading == "one shade" else f"; brighter is more {self.shading}"
        return f"Points of a frame: {kept}; rounded to {100 * STEP:g} cm{shaded}."


def thin(points: np.ndarray, limit: int, frame: int) -> np.ndarray:
    """At most `limit` of the points (n, C), drawn at random with the frame as seed."""
    if len(points) <= limit:
        return points
    rows = np.random.default_rng(frame).choice(len(points), limit, replace=False)
    return points[np.sort(rows)]


def pack_points(points: np.ndarray) -> str:
    """(n, 3 or 4) points -> base64: xyz as int16 in steps of `STEP`, then shading as uint8.

    The fourth column is the shading, 0 to 1. Points beyond the range of int16 (327 m) are
    omitted.
    """
    steps = np.round(points[:, :3] / STEP)
    inside = (np.abs(steps) <= np.iinfo(np.int16).max).all(axis=1)
    shade = points[:, 3] if points.shape[1] > 3 else np.full(len(points), 0.5)
    shade = np.round(255 * np.clip(shade, 0, 1)).astype(np.uint8)
    data = steps[inside].astype("<i2").tobytes() + shade[inside].tobytes()
    return base64.b64encode(data).decode("ascii")
