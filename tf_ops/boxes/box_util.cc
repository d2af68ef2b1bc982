#include "boxes/box_util.h"

#include "boxes/rotated.h"

namespace ptn {

absl::Status check_boxes(const tf::Tensor& boxes, const char* name) {
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

absl::Status check_same_batch(const tf::Tensor& a, const tf::Tensor& b, const char* names) {
  if (a.dims() != b.dims() || batch_of(a) != batch_of(b)) {
    return invalid(names, " must have the same rank and batch size, received ",
                   a.shape().DebugString(), " and ", b.shape().DebugString());
  }
  return absl::OkStatus();
}

}  // namespace ptn
