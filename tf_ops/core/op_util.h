// Helpers of the op kernels: input checks, threads, shapes, registration.
#pragma once

#include <cstdint>
#include <initializer_list>
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

// points (B, N, C) has N > 0, unless the output has no elements (`wanted` is 0).
absl::Status check_not_empty(const tf::Tensor& points, const char* name, int64_t wanted);

// Allocates an output; InvalidArgument if no tensor can have these sizes. (TensorFlow's own
// function takes a shape, and making one of sizes whose product overflows ends the process.)
absl::Status allocate(tf::OpKernelContext* context, int output,
                      std::initializer_list<int64_t> sizes, tf::Tensor** tensor);

// The tensor has these sizes, whose product may overflow.
bool has_sizes(const tf::Tensor& tensor, std::initializer_list<int64_t> sizes);

// grouped (B, ..., C) has the sizes of index (B, ...), and one more.
bool is_grouped(const tf::Tensor& grouped, const tf::Tensor& index);

// Advises huge pages for a large output that is about to be written for the first time: page faults
// of small pages are most of the cost of such an output.
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

// Checks index (B, ...) against points (B, N, C) and allocates output 0 of that shape.
absl::Status make_grouped(tf::OpKernelContext* context, const tf::Tensor& points,
                          const tf::Tensor& index, tf::Tensor** grouped);

// Reads an int attribute that must be at least 1.
void read_count(tf::OpKernelConstruction* context, const char* name, int32_t* value);

// Registers the CPU kernel Op<T> of "PointTrackNet>`name`" for each type that features may have.
#define PTN_REGISTER_FOR_FEATURES(name, Op)     \
  PTN_REGISTER_FOR_TYPE(name, Op, float);       \
  PTN_REGISTER_FOR_TYPE(name, Op, Eigen::half); \
  PTN_REGISTER_FOR_TYPE(name, Op, Eigen::bfloat16)
#define PTN_REGISTER_FOR_TYPE(name, Op, Type) \
  REGISTER_KERNEL_BUILDER(                    \
      Name("PointTrackNet>" name).Device(tf::DEVICE_CPU).TypeConstraint<Type>("T"), Op<Type>)

}  // namespace ptn
