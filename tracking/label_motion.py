"""Motion of the labelled objects, for the paper's upper bound "gt_tracking" (section IV.D)."""

from dataclasses import dataclass

import numpy as np

from kitti.iou import iou_3d
from kitti.targets import association_displacement
from tracking.assignment import greedy

MIN_IOU = 0.25  # 3-D, of a detection with its label; the loosest of AB3DMOT's evaluation


@dataclass(frozen=True)
class LabelMotion:
    """Movement of labelled objects from frame t-1 to t, found by label id.

    Attributes:
        boxes_previous, ids_previous: labels of frame t-1, (M, 7) and (M,), level frame.
        boxes, ids: labels of frame t, (K, 7) and (K,).
    """

    boxes_previous: np.ndarray
    ids_previous: np.ndarray
    boxes: np.ndarray
    ids: np.ndarray

    def displacement(self, ids: np.ndarray) -> np.ndarray:
        """(T, 3) metres for the objects with label `ids` (T,); NaN if not in both frames."""
        motion, known = association_displacement(
            self.boxes_previous, self.ids_previous, self.boxes, self.ids
        )
        moved = dict(zip(np.asarray(self.ids_previous)[known].tolist(), motion[known], strict=True))
        unknown = np.full(3, np.nan)
        return np.array([moved.get(int(i), unknown) for i in ids]).reshape(-1, 3)

    def ids_of(self, boxes: np.ndarray) -> np.ndarray:
        """Label ids of detected boxes (M, 7) of frame t, see `assign_label_ids`."""
        return assign_label_ids(boxes, self.boxes, self.ids)


def assign_label_ids(
    boxes: np.ndarray, label_boxes: np.ndarray, label_ids: np.ndarray
) -> np.ndarray:
    """Label id of each detected box: that of the label it overlaps most, one-to-one.

    Args:
        boxes: (M, 7) detections; label_boxes (K, 7) and label_ids (K,) of the same frame.

    Returns:
        (M,) int64, -1 for a detection without a label.
    """
    ids = np.full(len(boxes), -1, np.int64)
    pairs = greedy(-iou_3d(boxes, label_boxes), -MIN_IOU).pairs
    ids[pairs[:, 0]] = np.asarray(label_ids)[pairs[:, 1]]
    return ids
