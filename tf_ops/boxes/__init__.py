"""Overlap and suppression of upright boxes (x, y, z, l, w, h, yaw). Not differentiable.

Boxes are in the level frame: the geometric centre in metres, yaw in radians counter-clockwise
about +z. Overlaps are computed in float64.
"""

import tensorflow as tf

from tf_ops.devices import on_cpu
from tf_ops.loading import load_library

for _name in ("BoxIou3d", "SuppressBoxes"):
    tf.no_gradient(f"PointTrackNet>{_name}")


@on_cpu
def box_iou_3d(boxes1: tf.Tensor, boxes2: tf.Tensor) -> tf.Tensor:
    """3-D IoU of upright, rotated boxes, for every pair of boxes1 and boxes2.

    Args:
        boxes1: (M, 7) or (B, M, 7) float32.
        boxes2: (K, 7) or (B, K, 7) float32.

    Returns:
        (M, K) or (B, M, K) float32 in [0, 1]; 0 where both boxes are empty. Of a tensor with itself
        each pair is computed once, in half the time, and the result is symmetric.

    Raises:
        InvalidArgumentError: NaN or infinity, a negative size, or a wrong shape.
    """
    return load_library().point_track_net_box_iou3d(boxes1=boxes1, boxes2=boxes2)


@on_cpu
def suppress_boxes(
    boxes: tf.Tensor, weight: tf.Tensor, *, vote_iou: float, nms_iou: float, max_boxes: int
) -> tuple[tf.Tensor, tf.Tensor, tf.Tensor]:
    """Greedy non-maximum suppression by support, in one thread, without the IoU of every pair.

    The support of a box is the sum of IoU * weight over the boxes that it overlaps by `vote_iou`,
    itself included; sums are float64.

    Args:
        boxes: (P, 7) float32.
        weight: (P,) float32.
        vote_iou: least IoU of a box that supports another.
        nms_iou: a kept box takes those left that it overlaps by more.
        max_boxes: the most boxes that are kept, >= 1.

    Returns:
        kept: (K,) int32 rows of the kept boxes, most supported first, ties to the lower row.
        owner: (P,) int32, the place in `kept` of the box that takes each; -1 for none.
        iou: (K, P) float32, of the kept boxes with all.

    Raises:
        InvalidArgumentError: NaN or infinity, in the limits too, a negative size, or a wrong shape.
        ResourceExhaustedError: no memory.
    """
    return load_library().point_track_net_suppress_boxes(
        boxes=boxes, weight=weight, vote_iou=vote_iou, nms_iou=nms_iou, max_boxes=max_boxes
    )
