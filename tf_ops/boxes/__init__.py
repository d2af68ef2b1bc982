"""Overlap of upright boxes (x, y, z, l, w, h, yaw). Not differentiable.

Boxes are in the level frame: the geometric centre in metres, yaw in radians counter-clockwise
about +z. Overlaps are computed in float64.
"""

import tensorflow as tf

from tf_ops.devices import on_cpu
from tf_ops.loading import load_library

tf.no_gradient("PointTrackNet>BoxIou3d")


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
