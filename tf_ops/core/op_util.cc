#include "core/op_util.h"

#include <algorithm>
#include <cmath>
#include <utility>

#if defined(__linux__)
#  include <sys/mman.h>
#endif

#include "tensorflow/core/platform/threadpool.h"

namespace ptn {

Parallel threads_of(tf::OpKernelContext* context) {
  const auto* workers = context->device()->tensorflow_cpu_worker_threads();
  return shared_by(workers->num_threads, [workers](std::function<void()> helper) {
    workers->workers->Schedule(std::move(helper));
  });
}

namespace {

// Multi-index of a flat position, as "[0, 12, 2]".
std::string position(const tf::TensorShape& shape, int64_t flat) {
  std::string text;
  for (int d = shape.dims() - 1; d >= 0; --d) {
    text = std::to_string(flat % shape.dim_size(d)) + (text.empty() ? "" : ", ") + text;
    flat /= shape.dim_size(d);
  }
  return "[" + text + "]";
}

}  // namespace

absl::Status check_finite(const tf::Tensor& tensor, const char* name) {
  const float* values = tensor.flat<float>().data();
  const int64_t size = tensor.NumElements();
  // 0 * x is NaN for NaN and infinity alone; a sum over a stretch finds it without branches.
  constexpr int64_t kStretch = 1024;
  for (int64_t begin = 0; begin < size; begin += kStretch) {
    const int64_t end = std::min(begin + kStretch, size);
    float sum[16] = {};
    int64_t i = begin;
    for (; i + 16 <= end; i += 16) {
      for (int lane = 0; lane < 16; ++lane) sum[lane] += 0.0F * values[i + lane];
    }
    for (; i < end; ++i) sum[0] += 0.0F * values[i];
    if (std::all_of(sum, sum + 16, [](float s) { return s == 0.0F; })) continue;
    for (i = begin; std::isfinite(values[i]);) ++i;
    return invalid(name, position(tensor.shape(), i), " is ", values[i], "; values must be finite");
  }
  return absl::OkStatus();
}

absl::Status check_points(const tf::Tensor& tensor, const char* name) {
  if (tensor.dims() != 3 || tensor.dim_size(2) != 3) {
    return invalid(name, " must have shape (B, N, 3), received ", tensor.shape().DebugString());
  }
  if (tensor.dim_size(1) > std::numeric_limits<int32_t>::max() / 2) {
    return invalid(name, " has too many points for int32 indices: ", tensor.dim_size(1));
  }
  return check_finite(tensor, name);
}

absl::Status check_points(const tf::Tensor& tensor, const char* name, int64_t batch) {
  TF_RETURN_IF_ERROR(check_points(tensor, name));
  if (tensor.dim_size(0) != batch) {
    return invalid(name, " must have the batch size ", batch, ", received ",
                   tensor.shape().DebugString());
  }
  return absl::OkStatus();
}

absl::Status check_indices(const tf::Tensor& index, const char* name, int64_t limit) {
  const auto flat = index.flat<int32_t>();
  const int32_t* values = flat.data();
  const int64_t size = flat.size();
  const uint32_t bound = static_cast<uint32_t>(
      std::min<int64_t>(limit, int64_t{std::numeric_limits<int32_t>::max()} + 1));
  bool good = true;
  for (int64_t i = 0; i < size; ++i) good &= static_cast<uint32_t>(values[i]) < bound;
  if (good) return absl::OkStatus();
  int64_t i = 0;
  while (static_cast<uint32_t>(values[i]) < bound) ++i;
  return invalid(name, position(index.shape(), i), " = ", values[i], " is not in [0, ", limit, ")");
}

absl::Status check_not_empty(const tf::Tensor& points, const char* name, int64_t wanted) {
  if (wanted > 0 && points.dim_size(1) == 0) {
    return invalid(name, " has no points to choose from, received ", points.shape().DebugString());
  }
  return absl::OkStatus();
}

absl::Status allocate(tf::OpKernelContext* context, int output,
                      std::initializer_list<int64_t> sizes, tf::Tensor** tensor) {
  tf::TensorShape shape;
  TF_RETURN_IF_ERROR(tf::TensorShape::BuildTensorShape(sizes, &shape));
  return context->allocate_output(output, shape, tensor);
}

bool has_sizes(const tf::Tensor& tensor, std::initializer_list<int64_t> sizes) {
  const auto found = tensor.shape().dim_sizes();
  return std::equal(found.begin(), found.end(), sizes.begin(), sizes.end());
}

bool is_grouped(const tf::Tensor& grouped, const tf::Tensor& index) {
  if (grouped.dims() != index.dims() + 1) return false;
  for (int d = 0; d < index.dims(); ++d) {
    if (grouped.dim_size(d) != index.dim_size(d)) return false;
  }
  return true;
}

void prefer_huge_pages(tf::Tensor* output) {
#if defined(__linux__)
  constexpr uintptr_t kHugePage = uintptr_t{2} << 20;
  const uintptr_t begin = reinterpret_cast<uintptr_t>(output->data());
  const uintptr_t first = (begin + kHugePage - 1) / kHugePage * kHugePage;
  const uintptr_t last = (begin + output->TotalBytes()) / kHugePage * kHugePage;
  // Advice only: where it cannot be followed nothing changes.
  if (first < last) madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
#else
  (void)output;
#endif
}

absl::Status neighbour_shapes(tf::shape_inference::InferenceContext* c, const char* attribute,
                              bool counts) {
  tf::shape_inference::ShapeHandle points, queries;
  TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &points));
  TF_RETURN_IF_ERROR(c->WithRank(c->input(1), 3, &queries));
  tf::shape_inference::DimensionHandle three, batch;
  TF_RETURN_IF_ERROR(c->WithValue(c->Dim(points, 2), 3, &three));
  TF_RETURN_IF_ERROR(c->WithValue(c->Dim(queries, 2), 3, &three));
  TF_RETURN_IF_ERROR(c->Merge(c->Dim(points, 0), c->Dim(queries, 0), &batch));
  int64_t neighbours;
  TF_RETURN_IF_ERROR(c->GetAttr(attribute, &neighbours));
  const auto found = c->MakeShape({batch, c->Dim(queries, 1), c->MakeDim(neighbours)});
  c->set_output(0, found);
  c->set_output(1, counts ? c->MakeShape({batch, c->Dim(queries, 1)}) : found);
  return absl::OkStatus();
}

absl::Status grouped_shape(tf::shape_inference::InferenceContext* c) {
  tf::shape_inference::ShapeHandle points, index, out;
  TF_RETURN_IF_ERROR(c->WithRank(c->input(0), 3, &points));
  TF_RETURN_IF_ERROR(c->WithRankAtLeast(c->input(1), 2, &index));
  TF_RETURN_IF_ERROR(c->WithRankAtMost(index, tf::TensorShape::MaxDimensions() - 1, &index));
  if (c->RankKnown(index)) {
    tf::shape_inference::DimensionHandle batch;
    TF_RETURN_IF_ERROR(c->Merge(c->Dim(points, 0), c->Dim(index, 0), &batch));
    TF_RETURN_IF_ERROR(c->ReplaceDim(index, 0, batch, &index));
  }
  TF_RETURN_IF_ERROR(c->Concatenate(index, c->Vector(c->Dim(points, 2)), &out));
  c->set_output(0, out);
  return absl::OkStatus();
}

absl::Status make_grouped(tf::OpKernelContext* context, const tf::Tensor& points,
                          const tf::Tensor& index, tf::Tensor** grouped) {
  TF_RETURN_IF_ERROR(check_indices(index, "index", points.dim_size(1)));
  tf::TensorShape shape = index.shape();
  if (shape.dims() == tf::TensorShape::MaxDimensions()) {
    return invalid("index has too many dimensions: ", shape.dims());
  }
  TF_RETURN_IF_ERROR(shape.AddDimWithStatus(points.dim_size(2)));
  return context->allocate_output(0, shape, grouped);
}

void read_count(tf::OpKernelConstruction* context, const char* name, int32_t* value) {
  OP_REQUIRES_OK(context, context->GetAttr(name, value));
  OP_REQUIRES(context, *value >= 1, invalid(name, " must be at least 1, received ", *value));
}

}  // namespace ptn
