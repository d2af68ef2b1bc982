"""Pasting of cut objects into a scan, with what hides them and what they hide."""

from __future__ import annotations

import numpy as np

from kitti.boxes import points_in_boxes, wrap_angle
from kitti.footprints import overlaps_any
from kitti.ground import GroundModel
from training.frames import LabelledFrame
from training.object_bank import CutObject, ObjectBank, view

PLACES = 4
"""Directions that are tried for an object before it is left out."""
MIN_VISIBLE = 10
"""Points that must be left of a pasted object."""
MAX_INSIDE = 5
"""Points, ground left out, that may stand where the object is put; more are an obstacle."""
MAX_STEP = 1.0  # metres between the ground under the object in its own scan and in the other
ROOM = 0.2  # metres to other boxes on each side
CELL = np.deg2rad([0.3, 0.6])  # azimuth, elevation; coarser than the sensor, so cells have no gaps
BEHIND = 0.3  # metres along the ray from which a point counts as behind another


def paste_objects(
    frame: LabelledFrame, bank: ObjectBank, count: int, rng: np.random.Generator
) -> LabelledFrame:
    """Puts up to `count` objects of the bank into a frame; all randomness comes from rng.

    An object keeps its range, so that its points are as dense as they are there: it is turned
    about the sensor into a random direction of the view and set on the ground. It stays clear of
    all labelled boxes and of other obstacles, loses its points behind nearer ones, and hides the
    points behind it. Pasted objects get track ids of their own.
    """
    if not bank or not len(frame.points):
        return frame
    edges = view(frame.points)
    rays = _rays(frame.points)
    for _ in range(count):
        cut = bank.draw(rng)
        for azimuth in rng.uniform(*edges, PLACES):
            points, box = _place(cut, azimuth, frame.ground_model)
            pasted = _pasted(frame, rays, points, box, cut, edges)
            if pasted is not None:
                frame, rays = pasted
                break
    return frame


def _place(cut: CutObject, azimuth: float, ground: GroundModel) -> tuple[np.ndarray, np.ndarray]:
    """Points and box turned about the sensor to an azimuth (of the box's centre), on the ground."""
    turn = azimuth - np.arctan2(cut.box[1], cut.box[0])
    c, s = np.cos(turn), np.sin(turn)
    points, box = cut.points.copy(), cut.box.copy()
    for xy in (points[:, :2], box[None, :2]):
        xy[:] = xy @ np.array([[c, s], [-s, c]])
    box[6] = wrap_angle(box[6] + turn)
    rise = ground.height(box[None])[0] - (box[2] - box[5] / 2)
    box[2] += rise
    points[:, 2] += np.float32(rise)
    return points, box


def _pasted(frame, rays, points, box, cut: CutObject, edges):
    """The frame with an object added and the rays of its points; None where it has no room."""
    everything = np.concatenate([frame.boxes, frame.other_boxes])
    wide = box + np.array([0, 0, 0, 2 * ROOM, 2 * ROOM, 0, 0])
    if abs(box[2] - cut.box[2]) > MAX_STEP or overlaps_any(wide, everything):
        return None
    own = _rays(points)
    low, high = own[:, :2].min(axis=0) - 2 * CELL, own[:, :2].max(axis=0) + 2 * CELL
    near = np.flatnonzero((rays[:, 0] > low[0]) & (rays[:, 0] < high[0]))
    near = near[(rays[near, 1] > low[1]) & (rays[near, 1] < high[1])]
    inside = near[(points_in_boxes(frame.points[near], box[None]) == 0) & ~frame.ground[near]]
    if len(inside) > MAX_INSIDE:
        return None
    grid = np.full(((high - low) / CELL).astype(int) + 1, np.inf)
    cells = tuple(((own[:, :2] - low) / CELL).astype(int).T)
    scan_cells = ((rays[:, :2][near] - low) / CELL).astype(int).T
    standing = ~frame.ground[near]
    before = _nearest(grid, scan_cells[:, standing], rays[near[standing], 2])
    visible = (own[:, 2] < before[cells] + BEHIND) & (own[:, 0] > edges[0]) & (own[:, 0] < edges[1])
    if np.count_nonzero(visible) < MIN_VISIBLE:
        return None
    silhouette = _widened(_nearest(grid, np.array(cells)[:, visible], own[visible, 2]))
    keep = np.ones(len(rays), bool)
    keep[near[rays[near, 2] > silhouette[tuple(scan_cells)] + BEHIND]] = False
    keep[inside] = False
    points, own, nothing = points[visible], own[visible], np.zeros(np.count_nonzero(visible), bool)
    ids = np.concatenate([frame.track_ids, frame.other_ids])
    added = frame._replace(
        points=np.concatenate([frame.points[keep], points]),
        ground=np.concatenate([frame.ground[keep], nothing]),
        ignored=np.concatenate([frame.ignored[keep], nothing]),
        boxes=np.concatenate([frame.boxes, box[None]]),
        classes=np.append(frame.classes, np.int32(cut.class_index)),
        track_ids=np.append(frame.track_ids, ids.max(initial=-1) + 1),
    )
    return added, np.concatenate([rays[keep], own])


def _rays(points: np.ndarray) -> np.ndarray:
    """(n, 3) level points -> (n, 3) float32 azimuth, elevation (radians) and range (metres)."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), np.arctan2(z, flat), np.hypot(flat, z)], axis=1)


def _nearest(grid: np.ndarray, cells: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Least range in each cell of an empty grid; infinite where there is none."""
    least = grid.copy()
    np.minimum.at(least, tuple(cells), ranges)
    return least


def _widened(least: np.ndarray) -> np.ndarray:
    """The least range in each cell and its eight neighbours."""
    padded = np.pad(least, 1, constant_values=np.inf)
    rows, columns = least.shape
    parts = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.minimum.reduce(parts)
