// Threads of the algorithms, independent of the thread pool behind them.
#pragma once

#include <cstdint>
#include <functional>

namespace ptn {

// Works on the items [begin, end).
using Body = std::function<void(int64_t begin, int64_t end)>;

struct Parallel {
  // Splits [0, total) into ranges and runs the body on each; returns when all are done.
  // `cost` is the rough time of one item in nanoseconds: short work is not split.
  std::function<void(int64_t total, int64_t cost, const Body& body)> run;
  int threads = 1;
};

// Runs a function later in another thread.
using Schedule = std::function<void(std::function<void()>)>;

// The caller and threads - 1 helpers process ranges. The caller waits for ranges in progress, never
// for a helper to start. No range costs less than `least_cost` nanoseconds.
Parallel shared_by(int threads, const Schedule& schedule, int64_t least_cost = 20000);

// All work in the caller's thread.
inline Parallel serial() {
  return {[](int64_t total, int64_t, const Body& body) {
            if (total > 0) body(0, total);
          },
          1};
}

}  // namespace ptn
