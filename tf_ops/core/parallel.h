// How the algorithms ask for threads, without knowing whose threads they are.
#pragma once

#include <cstdint>
#include <functional>

namespace ptn {

// Works on the items [begin, end).
using Body = std::function<void(int64_t begin, int64_t end)>;

struct Parallel {
  // Splits [0, total) into ranges and runs the body on each; returns when all are done.
  // `cost` is the rough price of one item in nanoseconds: cheap work is not split.
  std::function<void(int64_t total, int64_t cost, const Body& body)> run;
  int threads = 1;
};

// Runs a function some time later in another thread.
using Schedule = std::function<void(std::function<void()>)>;

// The caller and threads - 1 helpers take ranges one after the other. The caller waits for ranges
// that were begun, never for a helper to begin. No range costs less than `least_cost` nanoseconds.
Parallel shared_by(int threads, const Schedule& schedule, int64_t least_cost = 20000);

// Everything in the caller's thread.
inline Parallel serial() {
  return {[](int64_t total, int64_t, const Body& body) {
            if (total > 0) body(0, total);
          },
          1};
}

}  // namespace ptn
