"""Measures of simulated against real scans over the same labelled boxes."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from kitti.boxes import points_in_boxes
from kitti.ground import fit_ground

BANDS = ((0, 15), (15, 30), (30, 50))  # metres
ENOUGH = 10  # points a box needs in the real scan
ABOVE_GROUND = 0.15  # metres above a box's bottom; lower points belong to the ground
HEIGHTS = np.linspace(-0.5, 4.0, 46)  # metres above the ground
BEAM_GAP = 0.2  # degrees; beams are a third of a degree apart or more, noise is far below
RANGES = np.linspace(0.0, 80.0, 41)  # metres


@dataclass(frozen=True)
class FrameCounts:
    """One frame's counts, real and simulated.

    points (2,); height, range histograms (2, n); per vehicle box: distance (M,), points (M, 2),
    beams (M, 2).
    """

    points: np.ndarray
    heights: np.ndarray
    ranges: np.ndarray
    distance: np.ndarray
    vehicle_points: np.ndarray
    vehicle_beams: np.ndarray


def count_beams(points_velo) -> int:
    """Number of beams among points (n, >= 3) of the velodyne frame, from gaps in elevation."""
    if not len(points_velo):
        return 0
    flat = np.hypot(points_velo[:, 0], points_velo[:, 1])
    elevation = np.sort(np.degrees(np.arctan2(points_velo[:, 2] - 0.2, flat)))
    return 1 + int((np.diff(elevation) > BEAM_GAP).sum())


def compare_frame(real, simulated, boxes, calib) -> FrameCounts:
    """Counts for scans (n, 4) and (m, 4) of the level frame and vehicle boxes (M, 7)."""
    boxes = np.asarray(boxes).reshape(-1, 7)
    rows = len(boxes)
    points, beams = np.zeros((rows, 2), int), np.zeros((rows, 2), int)
    heights, ranges = np.zeros((2, len(HEIGHTS) - 1)), np.zeros((2, len(RANGES) - 1))
    for side, scan in enumerate((real, simulated)):
        owner = points_in_boxes(scan, boxes, 0.05)
        for row in range(rows):
            bottom = boxes[row, 2] - boxes[row, 5] / 2 + ABOVE_GROUND
            inside = scan[(owner == row) & (scan[:, 2] > bottom), :3]
            points[row, side] = len(inside)
            beams[row, side] = count_beams(calib.level_to_velo(inside))
        above = scan[:, 2] - fit_ground(scan).height(scan[:, :2])
        heights[side] = np.histogram(above, HEIGHTS)[0]
        ranges[side] = np.histogram(np.hypot(scan[:, 0], scan[:, 1]), RANGES)[0]
    distance = np.hypot(boxes[:, 0], boxes[:, 1])
    return FrameCounts(
        np.array([len(real), len(simulated)]), heights, ranges, distance, points, beams
    )


def histogram_distance(a, b) -> float:
    """Half the sum of absolute differences of two normalised histograms: 0 same, 1 disjoint."""
    return float(np.abs(a / max(a.sum(), 1) - b / max(b.sum(), 1)).sum() / 2)


def summarise(worlds: list[list[FrameCounts]]) -> dict[str, float | int | None]:
    """The measures over the same frames in each of several random worlds.

    Ratios are simulated / real, None without boxes; frames and boxes are counted once.
    """
    frames = [frame for world in worlds for frame in world]
    distance = np.concatenate([f.distance for f in frames])
    points = np.concatenate([f.vehicle_points for f in frames]).astype(float)
    beams = np.concatenate([f.vehicle_beams for f in frames]).astype(float)
    enough = points[:, 0] >= ENOUGH
    per_frame = np.array([f.points for f in frames], float)
    result: dict[str, float | int | None] = {
        "frames": len(worlds[0]),
        "random worlds": len(worlds),
        "real points per frame": float(per_frame[:, 0].mean()),
        "points per frame, ratio": float((per_frame[:, 1] / per_frame[:, 0]).mean()),
        "vehicle boxes": int(enough.sum()) // len(worlds),
        "points per vehicle, median ratio": _ratio(points, enough),
        "points per vehicle, Spearman": float(
            spearmanr(points[enough, 0], points[enough, 1]).statistic
        ),
        "beams per vehicle, median ratio": _ratio(beams, enough),
        "beams per vehicle, mean ratio": float(beams[enough, 1].sum() / beams[enough, 0].sum()),
    }
    for low, high in BANDS:
        chosen = enough & (distance >= low) & (distance < high)
        result[f"points per vehicle {low}-{high} m, boxes"] = int(chosen.sum()) // len(worlds)
        result[f"points per vehicle {low}-{high} m, median ratio"] = _ratio(points, chosen)
    heights, ranges = (sum(getattr(f, name) for f in frames) for name in ("heights", "ranges"))
    result["heights above ground, histogram distance"] = histogram_distance(*heights)
    result["ranges, histogram distance"] = histogram_distance(*ranges)
    return result


def _ratio(counts, chosen) -> float | None:
    if not chosen.any():
        return None
    return float(np.median(counts[chosen, 1] / np.maximum(counts[chosen, 0], 1)))
