"""Looks at a few scans of a sequence: do they fit its calibration and its labels?"""

import numpy as np

from common.errors import InputError
from kitti.boxes import points_in_boxes
from kitti.camera_view import check_view
from kitti.scans.scan_files import read_scan
from kitti.sequence import KittiSequence

PROBED = 5  # frames
_NEAR = 40.0  # metres; nearly every labelled object that is not hidden holds points there
_BOXES = 4  # fewer do not tell
_LEAST_SHARE = 0.2  # of the boxes that hold a point


def check_points(sequence: KittiSequence) -> None:
    """Reads up to `PROBED` scans, and labelled frames' as many.

    Raises:
        InputError: as `check_view`, or hardly any labelled box holds a point: the axes are in
            another order, or the calibration or the labels are of another sequence.
    """
    frames = [t for t in sequence.frames if sequence.has_scan(t)]
    if not frames:
        return
    scans = (read_scan(sequence.scan_path(t)) for t in _some(frames))
    try:
        check_view(scans, sequence.calib, sequence.image_size)
        _check_boxes(sequence, frames)
    except InputError as error:
        if error.path is not None:
            raise
        raise InputError(str(error), sequence.scan_path(frames[0]).parent) from error


def _some(frames: list[int]) -> list[int]:
    places = np.linspace(0, len(frames) - 1, min(PROBED, len(frames)))
    return [frames[round(place)] for place in places]


def _check_boxes(sequence: KittiSequence, frames: list[int]) -> None:
    objects = sequence.objects
    clear = (objects.occlusion <= 0) & (np.linalg.norm(objects.boxes[:, :2], axis=1) < _NEAR)
    objects = objects[clear]  # a row without a box has NaN there, which is not below
    labelled = np.intersect1d(frames, objects.frame).tolist()
    held = total = 0
    for t in _some(labelled) if labelled else []:
        boxes = objects.boxes[objects.frame == t]
        owner = points_in_boxes(sequence.read_points_level(t), boxes)
        held, total = held + len(np.unique(owner[owner >= 0])), total + len(boxes)
    if total >= _BOXES and held < _LEAST_SHARE * total:
        raise InputError(
            f"{held} of {total} labelled boxes hold a point: expected x ahead, y left, z up in "
            "metres, and scans, calibration and labels of the same sequence"
        )
