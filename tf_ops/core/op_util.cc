#include "core/op_util.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <memory>
#include <mutex>

#if defined(__linux__)
#  include <sys/mman.h>
#endif

#include "tensorflow/core/platform/threadpool.h"

namespace ptn {

namespace {

// Ranges of one call of Parallel::run, taken one after the other by the calling thread and by
// helpers of TensorFlow's pool. The caller waits for ranges that were begun, never for a helper to
// begin: one that wakes up late finds nothing left to do, and touches nothing but this object.
class Ranges {
 public:
  Ranges(int64_t total, int64_t size, const Body& body)
      : total_(total), size_(size), body_(&body) {}

  void work() {
    for (;;) {
      const int64_t begin = next_.fetch_add(size_);
      if (begin >= total_) return;
      const int64_t end = std::min(begin + size_, total_);
      (*body_)(begin, end);
      if (done_.fetch_add(end - begin) + end - begin < total_) continue;
      const std::lock_guard<std::mutex> lock(mutex_);
      all_done_.notify_all();
    }
  }

  void wait() {
    std::unique_lock<std::mutex> lock(mutex_);
    all_done_.wait(lock, [this] { return done_.load() == total_; });
  }

 private:
  const int64_t total_, size_;
  const Body* const body_;  // lives until the caller has waited
  std::atomic<int64_t> next_{0}, done_{0};
  std::mutex mutex_;
  std::condition_variable all_done_;
};

}  // namespace

Parallel threads_of(tf::OpKernelContext* context) {
  constexpr int64_t kLeastCost = 20000;  // nanoseconds of a range that is worth a helper
  constexpr int64_t kRangesPerThread = 4;
  const auto* workers = context->device()->tensorflow_cpu_worker_threads();
  const int64_t threads = workers->num_threads;
  return {[workers, threads](int64_t total, int64_t cost, const Body& body) {
            if (total <= 0) return;
            const int64_t size = 1 + std::max((total - 1) / (threads * kRangesPerThread),
                                              kLeastCost / std::max<int64_t>(cost, 1));
            const int64_t count = (total - 1) / size + 1;
            if (threads == 1 || count == 1) return body(0, total);
            const auto ranges = std::make_shared<Ranges>(total, size, body);
            for (int64_t i = 1; i < std::min(threads, count); ++i) {
              workers->workers->Schedule([ranges] { ranges->work(); });
            }
            ranges->work();
            ranges->wait();
          },
          workers->num_threads};
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

void read_count(tf::OpKernelConstruction* context, const char* name, int32_t* value) {
  OP_REQUIRES_OK(context, context->GetAttr(name, value));
  OP_REQUIRES(context, *value >= 1, invalid(name, " must be at least 1, received ", *value));
}

}  // namespace ptn
