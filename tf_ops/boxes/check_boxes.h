// Checks of boxes that ops receive.
#pragma once

#include "boxes/box_iou_3d.h"
#include "core/op_util.h"

namespace ptn {

// (M, 7) or (B, M, 7), finite, sizes not negative.
inline absl::Status check_boxes(const tf::Tensor& boxes, const char* name) {
  const int rank = boxes.dims();
  if (rank < 2 || rank > 3 || boxes.dim_size(rank - 1) != kBoxSize) {
    return invalid(name, " must have shape (M, 7) or (B, M, 7), received ",
                   boxes.shape().DebugString());
  }
  TF_RETURN_IF_ERROR(check_finite(boxes, name));
  const float* values = boxes.flat<float>().data();
  for (int64_t i = 0; i < boxes.NumElements(); i += kBoxSize) {
    for (int64_t size = i + 3; size < i + 6; ++size) {
      if (values[size] < 0) {
        return invalid(name, ": box ", i / kBoxSize, " has the negative size ", values[size]);
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace ptn
