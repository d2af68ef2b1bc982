"""Upright boxes (x, y, z, l, w, h, yaw): overlap and suppression. Not differentiable.

Boxes are in the level frame: the geometric centre in metres, yaw in radians counter-clockwise
about +z. Overlaps are computed in float64.
"""

from __future__ import annotations

import tensorflow as tf

from tf_ops.devices import on_cpu
from tf_ops.loading import load_library

for _name in ("BoxIou", "Nms3d"):
    tf.no_gradient(f"PointTrackNet>{_name}")


@on_cpu
def box_iou_3d(boxes1: tf.Tensor, boxes2: tf.Tensor) -> tf.Tensor:
    """3-D IoU of upright, rotated boxes, for every pair of boxes1 and boxes2.

    Args:
        boxes1: (M, 7) or (B, M, 7) float32.
        boxes2: (K, 7) or (B, K, 7) float32.

    Returns:
        (M, K) or (B, M, K) float32 in [0, 1]; 0 where both boxes are empty.

    Raises:
        InvalidArgumentError: NaN or infinity, a negative size, or a wrong shape.
    """
    return load_library().point_track_net_box_iou(boxes1=boxes1, boxes2=boxes2, bev=False)


@on_cpu
def nms_3d(boxes: tf.Tensor, scores: tf.Tensor, iou_threshold: float, max_output: int) -> tf.Tensor:
    """Greedy non-maximum suppression by rotated bird's-eye-view IoU.

    Args:
        boxes: (M, 7) float32.
        scores: (M,) float32.
        iou_threshold: a box is dropped where its IoU with a kept one is above it; in [0, 1].
        max_output: at most so many are kept, >= 1.

    Returns:
        (K,) int32 indices of the kept boxes by falling score, ties by index.

    Raises:
        InvalidArgumentError: NaN or infinity, a negative size, a threshold outside [0, 1], or a
            wrong shape.
    """
    return load_library().point_track_net_nms3d(
        boxes=boxes, scores=scores, iou_threshold=iou_threshold, max_output=max_output
    )
