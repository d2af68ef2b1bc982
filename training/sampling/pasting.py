"""Pastes cut objects into a scan, with their occlusion by the scan and of the scan."""

import numpy as np

from kitti.boxes import points_in_boxes, wrap_angle
from kitti.ground import GroundModel
from kitti.iou import footprints_overlap
from training.sampling.frames import LabelledFrame
from training.sampling.object_bank import CutObject, ObjectBank, view

PLACES = 4
"""Directions tried for an object before it is skipped."""
MIN_VISIBLE = 10
"""Fewest visible points of a pasted object."""
MAX_INSIDE = 5
"""Most points above the ground at the place of the object; more are an obstacle."""
MAX_STEP = 1.0  # metres between the ground under the object in its own scan and in the other
ROOM = 0.2  # metres to other boxes on each side
CELL = np.deg2rad([0.3, 0.6])  # azimuth, elevation; coarser than the sensor, so cells have no gaps
BEHIND = 0.3  # metres along the ray from which a point counts as behind another


def paste_objects(
    frame: LabelledFrame, bank: ObjectBank, count: int, rng: np.random.Generator
) -> LabelledFrame:
    """Pastes up to `count` objects of the bank into a frame; rng is the only source of randomness.

    An object keeps its horizontal range and so its density of points: it is rotated about the
    vertical axis of the level frame into a random direction of the view and placed on the ground.
    The rays that decide what is hidden also begin at the level frame's origin, the rectified
    camera: on KITTI 0.27 m ahead of the scanner and 0.08 m below it. An object must not overlap
    labelled boxes or other obstacles; its points behind nearer ones are removed, and so are the
    points behind it.
    Pasted objects get new track ids.
    """
    if not bank or not len(frame.points):
        return frame
    edges, rays = view(frame.points), _rays(frame.points)
    for _ in range(count):
        cut = bank.draw(rng)
        turns = rng.uniform(*edges, PLACES) - np.arctan2(cut.box[1], cut.box[0])
        boxes = _placed_boxes(cut, turns, frame.ground_model)
        for place in np.flatnonzero(_has_room(cut, boxes, frame)):
            points = _turned(cut.points, turns[place])
            points[:, 2] += np.float32(boxes[place, 2] - cut.box[2])
            pasted = _pasted(frame, rays, points, boxes[place], cut.class_index, edges)
            if pasted is not None:
                frame, rays = pasted
                break
    return frame


def _turned(xyz: np.ndarray, turn: float) -> np.ndarray:
    """(n, >= 3) turned about the level frame's vertical axis by radians."""
    c, s = np.cos(turn), np.sin(turn)
    turned = xyz.copy()
    turned[:, :2] = xyz[:, :2] @ np.array([[c, s], [-s, c]], xyz.dtype)
    return turned


def _placed_boxes(cut: CutObject, turns: np.ndarray, ground: GroundModel) -> np.ndarray:
    """(P, 7): the object's box turned like `_turned` by each turn (P,), on the ground."""
    boxes = np.concatenate([_turned(cut.box[None], turn) for turn in turns])
    boxes[:, 6] = wrap_angle(boxes[:, 6] + turns)
    boxes[:, 2] = ground.height(boxes) + boxes[:, 5] / 2
    return boxes


def _has_room(cut: CutObject, boxes: np.ndarray, frame: LabelledFrame) -> np.ndarray:
    """(P,) bool: on ground about as high as the object's own, and clear of all labelled boxes."""
    wide = boxes + np.array([0, 0, 0, 2 * ROOM, 2 * ROOM, 0, 0])
    everything = np.concatenate([frame.boxes, frame.other_boxes])
    taken = footprints_overlap(wide[:, None], everything[None]).any(axis=1)
    return ~taken & (np.abs(boxes[:, 2] - cut.box[2]) <= MAX_STEP)


def _pasted(frame, rays, points, box, class_index: int, edges):
    """The frame with an object added and the rays of its points; None where it is hidden."""
    own = _rays(points)
    low, high = own[:2].min(axis=1) - 2 * CELL, own[:2].max(axis=1) + 2 * CELL
    near = np.flatnonzero((rays[0] > low[0]) & (rays[0] < high[0]))
    near = near[(rays[1, near] > low[1]) & (rays[1, near] < high[1])]
    standing = ~frame.ground[near]
    inside = near[(points_in_boxes(frame.points[near], box[None]) == 0) & standing]
    if len(inside) > MAX_INSIDE:
        return None
    shape = ((high - low) / CELL).astype(int) + 1
    cells, own_cells = _cells(rays[:, near], low), _cells(own, low)
    before = _nearest(shape, cells[:, standing], rays[2, near[standing]])
    visible = own[2] < before[tuple(own_cells)] + BEHIND
    visible &= (own[0] > edges[0]) & (own[0] < edges[1])
    seen = np.count_nonzero(visible)
    if seen < MIN_VISIBLE:
        return None
    silhouette = _widened(_nearest(shape, own_cells[:, visible], own[2, visible]))
    keep = np.ones(len(frame.points), bool)
    keep[near[rays[2, near] > silhouette[tuple(cells)] + BEHIND]] = False
    keep[inside] = False
    nothing = np.zeros(seen, bool)
    ids = np.concatenate([frame.track_ids, frame.other_ids])
    added = frame._replace(
        points=np.concatenate([frame.points[keep], points[visible]]),
        ground=np.concatenate([frame.ground[keep], nothing]),
        ignored=np.concatenate([frame.ignored[keep], nothing]),
        boxes=np.concatenate([frame.boxes, box[None]]),
        classes=np.append(frame.classes, np.int32(class_index)),
        track_ids=np.append(frame.track_ids, ids.max(initial=-1) + 1),
    )
    return added, np.concatenate([rays[:, keep], own[:, visible]], axis=1)


def _rays(points: np.ndarray) -> np.ndarray:
    """(n, 3) level points -> (3, n) float32 azimuth, elevation (radians) and range (metres).

    Seen from the level frame's origin.
    """
    x, y, z = np.ascontiguousarray(points.T)
    flat = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), np.arctan2(z, flat), np.hypot(flat, z)])


def _cells(rays: np.ndarray, low: np.ndarray) -> np.ndarray:
    """(3, n) rays -> (2, n) cells of azimuth and elevation, counted from `low`."""
    return ((rays[:2] - low[:, None]) / CELL[:, None]).astype(int)


def _nearest(shape: np.ndarray, cells: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Least range in each cell of a grid of that shape; infinite in an empty cell."""
    least = np.full(shape, np.inf)
    np.minimum.at(least, tuple(cells), ranges)
    return least


def _widened(least: np.ndarray) -> np.ndarray:
    """The least range in each cell and its eight neighbours."""
    padded = np.pad(least, 1, constant_values=np.inf)
    rows, columns = least.shape
    parts = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.minimum.reduce(parts)
