#include "core/parallel.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>

namespace ptn {

namespace {

// Ranges of one call of Parallel::run. A helper that starts late finds no range left and touches
// only this object, whose ownership all helpers share.
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
  const Body* const body_;  // valid until the caller has waited
  std::atomic<int64_t> next_{0}, done_{0};
  std::mutex mutex_;
  std::condition_variable all_done_;
};

}  // namespace

Parallel shared_by(int threads, const Schedule& schedule, int64_t least_cost) {
  constexpr int64_t kRangesPerThread = 4;
  return {[=](int64_t total, int64_t cost, const Body& body) {
            if (total <= 0) return;
            const int64_t size = 1 + std::max((total - 1) / (threads * kRangesPerThread),
                                              least_cost / std::max<int64_t>(cost, 1));
            const int64_t count = (total - 1) / size + 1;
            if (threads == 1 || count == 1) return body(0, total);
            const auto ranges = std::make_shared<Ranges>(total, size, body);
            for (int64_t i = 1; i < std::min<int64_t>(threads, count); ++i) {
              schedule([ranges] { ranges->work(); });
            }
            ranges->work();
            ranges->wait();
          },
          threads};
}

}  // namespace ptn
