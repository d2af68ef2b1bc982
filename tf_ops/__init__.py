"""Point cloud ops for TensorFlow: sampling, grouping, interpolation, boxes. Built by `make ops`.

Letters: B batch, N points, M queries or sampled points, K neighbours, C channels. Indices are
int32. Squared distances are float32, computed as (dx * dx + dy * dy) + dz * dz; below 1.2e-38 they
count as 0, since TensorFlow flushes denormal numbers.
"""

from tf_ops.boxes import box_iou_3d, suppress_boxes
from tf_ops.grouping import group_difference, group_point, knn_point, query_ball_point
from tf_ops.interpolation import three_interpolate, three_nn
from tf_ops.loading import LibraryError, load_library
from tf_ops.sampling import farthest_point_sample, gather_point

__all__ = [
    "LibraryError",
    "box_iou_3d",
    "farthest_point_sample",
    "gather_point",
    "group_difference",
    "group_point",
    "knn_point",
    "load_library",
    "query_ball_point",
    "suppress_boxes",
    "three_interpolate",
    "three_nn",
]
