"""Training targets: foreground points and association displacements (section IV.A)."""

import numpy as np

from kitti.boxes import points_in_boxes
from kitti.ground import GroundModel, ground_mask


def foreground_labels(
    points: np.ndarray, boxes: np.ndarray, ground: np.ndarray | GroundModel | None = None
) -> np.ndarray:
    """Index of the object of each point (section IV.A).

    Args:
        points: (n, >= 3), level frame, metres.
        boxes: (M, 7) labelled boxes of the frame.
        ground: (n,) bool, True for ground points, or a model of the ground; ground points inside
            a box count as background. None: no point is ground.

    Returns:
        (n,) int32: index of the (first) box, or -1 for background.
    """
    index = points_in_boxes(points, boxes)
    if ground is None:
        return index
    inside = np.flatnonzero(index >= 0)
    if isinstance(ground, GroundModel):
        on_ground = ground_mask(points[inside], ground)
    else:
        on_ground = np.asarray(ground, bool)[inside]
    index[inside[on_ground]] = -1
    return index


def association_displacement(
    boxes_t1: np.ndarray, ids_t1: np.ndarray, boxes_t: np.ndarray, ids_t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Movement of the box centres of frame t - 1 (`t1`) to frame t, each in its sensor's frame.

    Args:
        boxes_t1, ids_t1: (M, 7) boxes and (M,) track ids of frame t - 1.
        boxes_t, ids_t: (K, 7) and (K,) of frame t; no id occurs twice.

    Returns:
        disp (M, 3) float64 metres, 0 where the object is not in frame t; valid (M,) bool.
    """
    boxes_t1, boxes_t = (np.asarray(b, np.float64).reshape(-1, 7) for b in (boxes_t1, boxes_t))
    same = np.asarray(ids_t1)[:, None] == np.asarray(ids_t)[None]  # (M, K)
    valid = same.any(axis=1)
    disp = np.zeros((len(boxes_t1), 3))
    if valid.any():
        partner = same.argmax(axis=1)[valid]
        disp[valid] = boxes_t[partner, :3] - boxes_t1[valid, :3]
    return disp, valid


def point_displacement(box_index: np.ndarray, disp: np.ndarray) -> np.ndarray:
    """Displacement of each point: that of its box, 0 for background.

    Args:
        box_index: (n,) index into the boxes, or -1, as `foreground_labels` gives it.
        disp: (M, 3) displacement of each box.

    Returns:
        (n, 3) float32 metres.
    """
    with_background = np.concatenate([np.asarray(disp, np.float32), np.zeros((1, 3), np.float32)])
    return with_background[np.asarray(box_index)]  # index -1 is the row of zeros
