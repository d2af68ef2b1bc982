// What every op's kernel needs from TensorFlow: checks at the door, threads, shapes.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/kernels.h"
#include "tensorflow/core/framework/common_shape_fns.h"
#include "tensorflow/core/framework/op.h"
#include "tensorflow/core/framework/op_kernel.h"
#include "tensorflow/core/framework/shape_inference.h"

namespace ptn {

namespace tf = tensorflow;

// An InvalidArgument status whose message is all parts in a row.
template <class... Parts>
absl::Status invalid(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

// TensorFlow's own thread pool, the caller's thread included.
Parallel threads_of(tf::OpKernelContext* context);

// A (B, N, 3) float32 tensor of finite coordinates, else InvalidArgument naming `name`.
absl::Status check_points(const tf::Tensor& tensor, const char* name);

// As check_points, and the batch is `batch`.
absl::Status check_points(const tf::Tensor& tensor, const char* name, int64_t batch);

// All values of a float32 tensor are finite.
absl::Status check_finite(const tf::Tensor& tensor, const char* name);

// All of `index` lie in [0, limit).
absl::Status check_indices(const tf::Tensor& index, const char* name, int64_t limit);

// There is something to choose from, unless nothing is asked for (`wanted` elements).
absl::Status check_not_empty(const tf::Tensor& points, const char* name, int64_t wanted);

// Asks for huge pages behind a large output that is about to be written for the first time: most of
// the price of such an output is the kernel's handing over of one small page after another.
void prefer_huge_pages(tf::Tensor* output);

inline Clouds clouds_of(const tf::Tensor& t) {
  return {t.flat<float>().data(), t.dim_size(0), t.dim_size(1)};
}

// Shapes of ops that find `attribute` neighbours for each query: (B, N, 3), (B, M, 3) ->
// (B, M, attribute), and (B, M) if `counts`, else (B, M, attribute) again.
absl::Status neighbour_shapes(tf::shape_inference::InferenceContext* c, const char* attribute,
                              bool counts);

// Shape of rows fetched by index: (B, N, C), (B, ...) -> (B, ..., C).
absl::Status grouped_shape(tf::shape_inference::InferenceContext* c);

// Reads an int attribute that must be at least 1.
void read_count(tf::OpKernelConstruction* context, const char* name, int32_t* value);

}  // namespace ptn
