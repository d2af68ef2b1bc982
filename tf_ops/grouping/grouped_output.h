// The output of ops that fetch rows by index.
#pragma once

#include "core/op_util.h"

namespace ptn {

// Checks index (B, ...) against points (B, N, C) and makes output 0, of shape (B, ..., C).
inline absl::Status make_grouped(tf::OpKernelContext* context, const tf::Tensor& points,
                                 const tf::Tensor& index, tf::Tensor** grouped) {
  const absl::Status in_range = check_indices(index, "index", points.dim_size(1));
  if (!in_range.ok()) return in_range;
  tf::TensorShape shape = index.shape();
  shape.AddDim(points.dim_size(2));
  return context->allocate_output(0, shape, grouped);
}

}  // namespace ptn
