"""Looks at the boxes of results and detections: do they fit the calibration and the labels?"""

from pathlib import Path

import numpy as np

from common.notes import note
from kitti.boxes import project_boxes
from kitti.calibration import Calibration
from kitti.iou import iou_2d_pairs
from kitti.objects import Objects

_FEW_BOXES = 10  # fewer do not tell
_LEAST_OVERLAP = 0.4  # median, of boxes in 2-D and 3-D; KITTI's labels have 0.7 to 0.98
_NEAR = 3.0  # metres; a box farther from every label is a false alarm
_AWAY = 0.3  # metres; less is the error of a detector
_EXPECTED = (
    "expected x y z of the bottom's centre in the rectified camera 0 (right, down, ahead), and "
    "the calibration of this sequence"
)


def note_projection(
    rows: Objects, calib: Calibration, image_size: tuple[int, int], path: str | Path
) -> None:
    """Notes 3-D boxes that do not project to the 2-D boxes beside them or lie out of view."""
    rows = rows[~np.isnan(rows.boxes[:, 0])]
    given = (rows.bbox[:, 2:] > rows.bbox[:, :2]).all(axis=1)
    projected = project_boxes(rows.boxes, calib, image_size)
    if given.sum() >= _FEW_BOXES:
        overlap = np.median(iou_2d_pairs(projected[given], rows.bbox[given]))
        if overlap < _LEAST_OVERLAP:
            fault = f"do not project to the 2-D boxes (median IoU {overlap:.2f})"
            note(f"{path}: the 3-D boxes {fault}: {_EXPECTED}")
            return
    outside = int(np.isnan(projected[~given, 0]).sum())
    if outside >= _FEW_BOXES and outside > 0.5 * len(rows):
        fault = f"{outside} of {len(rows)} boxes lie outside the camera's view"
        note(f"{path}: {fault}, where KITTI has no labels: {_EXPECTED}")


def note_numbering(rows: Objects, labels: Objects, path: str | Path) -> None:
    """Notes boxes that fit the labels of the frame before or after theirs better."""
    rows, labels = (part[~np.isnan(part.boxes[:, 0])] for part in (rows, labels))
    shifts = (0, -1, 1)
    away = np.stack([_distances(rows, labels, shift) for shift in shifts])
    told = (away < _NEAR).any(axis=0) & (away < np.inf).all(axis=0)
    if told.sum() < _FEW_BOXES:
        return
    medians = np.median(away[:, told], axis=1)
    best = int(medians.argmin())
    if medians[0] > _AWAY and medians[best] < 0.5 * medians[0]:
        other, distances = f"t{shifts[best]:+d}", f"{medians[best]:.2f} m, not {medians[0]:.2f} m"
        note(
            f"{path}: the boxes of frame t fit the labels of frame {other} better (median distance "
            f"{distances}): expected the frame numbers of the labels, from 0"
        )


def _distances(rows: Objects, labels: Objects, shift: int) -> np.ndarray:
    """(R,) metres from above to the nearest label of the frame `shift` later; infinite without."""
    found = np.full(len(rows), np.inf)
    for frame in np.unique(rows.frame).tolist():
        truth, mine = labels.at(frame + shift).boxes[:, :2], rows.frame == frame
        offsets = np.linalg.norm(rows.boxes[mine, None, :2] - truth, axis=2)
        found[mine] = offsets.min(axis=1, initial=np.inf)
    return found
