// Checks and shapes shared by the box ops: rank 2 is one scene, rank 3 a batch of scenes.
#pragma once

#include "core/op_util.h"

namespace ptn {

// (M, 7) or (B, M, 7), finite, sizes not negative.
absl::Status check_boxes(const tf::Tensor& boxes, const char* name);

// The same rank and batch size.
absl::Status check_same_batch(const tf::Tensor& a, const tf::Tensor& b, const char* names);

inline int64_t batch_of(const tf::Tensor& t) { return t.dims() == 3 ? t.dim_size(0) : 1; }
inline int64_t rows_of(const tf::Tensor& t) { return t.dim_size(t.dims() - 2); }

}  // namespace ptn
