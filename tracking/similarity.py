"""Similarity of boxes by name, for the trackers that leave the choice."""

from common.errors import InputError
from kitti.iou import giou_3d, iou_3d

SIMILARITY = {"iou_3d": iou_3d, "giou_3d": giou_3d}
"""Name -> function of boxes (M, 7) and (N, 7): (M, N), IoU from 0 to 1 or GIoU from -1 to 1."""


def check_similarity(name: str) -> None:
    """Raises InputError unless `name` is in SIMILARITY."""
    if name not in SIMILARITY:
        raise InputError(f"similarity: expected one of {sorted(SIMILARITY)}, found {name!r}")
