"""Intermediate outputs of the networks in one frame, as data of the 3-D scene (Figures 3 and 4)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kitti.objects import Objects
from visualization.association import Neighborhood
from visualization.clip import Clip
from visualization.sampling import Samplings
from visualization.scene import pack, scene_data
from visualization.scene_points import FOREGROUND, thin

ARROWS = 300  # at most; more would hide each other
MIN_FOREGROUND = 0.5  # probability of a point whose association displacement is drawn
REACH = 3.0  # metres from the centre of a detection to those of its proposals
EARLIER, FILTERED, PLAIN = (255, 106, 106), (92, 230, 140), (255, 92, 160)  # RGB


@dataclass(frozen=True)
class NetworkFrame:
    """The networks' outputs at frame t, level frame, metres.

    Attributes:
        t: the frame.
        points: (N, 4) input points of the detector, and their foreground probability.
        detections: its boxes, ids by score.
        proposals, proposal_scores: (P, 7) boxes of single points and (P,) their probabilities.
        earlier: (K, 3) the points of frame t-1 that the tracker keeps.
        foreground: (K,) their foreground probability.
        displacement: (K, 3) their association displacement to frame t.
        samplings: the points that the tracker's layers sample (Fig. 3).
        neighborhood: the group of one point (Fig. 4).
    """

    t: int
    points: np.ndarray
    detections: Objects
    proposals: np.ndarray
    proposal_scores: np.ndarray
    earlier: np.ndarray
    foreground: np.ndarray
    displacement: np.ndarray
    samplings: Samplings
    neighborhood: Neighborhood


def owners(proposals: np.ndarray, detections: np.ndarray) -> np.ndarray:
    """(P,) row of the detection (M, 7) whose centre is nearest, within REACH; else -1."""
    if not len(detections):
        return np.full(len(proposals), -1)
    gap = np.linalg.norm(proposals[:, None, :3] - detections[None, :, :3], axis=2)
    return np.where(gap.min(axis=1) <= REACH, gap.argmin(axis=1), -1)


def network_data(clip: Clip, frame: NetworkFrame) -> dict[str, Any]:
    """The scene of one frame, JSON-ready; labels are those of `clip`."""
    alone, truth = range(frame.t, frame.t + 1), clip.truth.at(frame.t)
    still = Clip(clip.name, alone, lambda _: frame.points, Objects.empty(), truth)
    data = scene_data(
        still,
        {"detections": frame.detections},
        shading=FOREGROUND,
        points_per_frame=len(frame.points),
    )
    moving = frame.foreground >= MIN_FOREGROUND
    arrows = thin(np.column_stack([frame.earlier, frame.displacement])[moving], ARROWS, frame.t)
    view = frame.neighborhood
    data["network"] = {
        "sets": _sets(frame),
        "arrows": {
            "from": pack(arrows[:, :3], "float32"),
            "by": pack(arrows[:, 3:], "float32"),
        },
        "proposals": {
            "box": pack(frame.proposals, "float32"),
            "score": pack(frame.proposal_scores, "float32"),
            "owner": pack(owners(frame.proposals, frame.detections.boxes), "int32"),
        },
        "group": {
            "point": view.previous[view.chosen].tolist(),
            "neighbors": view.current[np.unique(view.group)].tolist(),
        },
    }
    data["notes"] += [
        f"Arrows: association displacement from frame {frame.t - 1} to {frame.t} of kept points "
        f"with a foreground probability of at least {MIN_FOREGROUND:g}: {len(arrows)} of "
        f"{np.count_nonzero(moving)}, drawn at random.",
        f"Proposals: boxes of single points, within {REACH:g} m of the chosen detection; click a "
        "detection to choose it.",
    ]
    return data


def _sets(frame: NetworkFrame) -> list[dict[str, Any]]:
    sets = [(f"Kept points of frame {frame.t - 1}", frame.earlier, EARLIER, 2.5, False)]
    for layer, filtered, plain in zip(*frame.samplings, strict=True):
        sets.append((f"{layer}, filtered", filtered, FILTERED, 5, False))
        sets.append((f"{layer}, unfiltered", plain, PLAIN, 5, False))
    return [
        {"name": name, "xyz": pack(xyz, "float32"), "color": color, "size": size, "visible": shown}
        for name, xyz, color, size, shown in sets
    ]
