// Shared by the parts of the stress program: real threads, and the count of failures.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "core/all_kernels.h"

namespace stress {

using ptn::Kernels;
using ptn::Parallel;
using Sets = std::vector<const Kernels*>;

inline std::atomic<int> failures{0};

inline void expect(bool good, const char* set, const char* what, int64_t size) {
  if (good) return;
  ++failures;
  std::fprintf(stderr, "%s: %s differs at size %lld\n", set, what, static_cast<long long>(size));
}

// Divides work as the ops do, over new threads and whatever its cost.
inline Parallel real_threads(int threads) {
  const auto schedule = [](std::function<void()> helper) {
    std::thread(std::move(helper)).detach();
  };
  return ptn::shared_by(threads, schedule, 0);
}

inline std::vector<float> normal(int64_t size, std::mt19937* random, float deviation = 1.0F) {
  std::normal_distribution<float> distribution(0, deviation);
  std::vector<float> values(static_cast<size_t>(size));
  for (float& value : values) value = distribution(*random);
  return values;
}

// Compare algorithms in all instruction sets and over threads with plain loops.
void clouds(const Sets& sets, uint32_t seed);
void normalization(const Sets& sets, uint32_t seed);
void rows(const Sets& sets, uint32_t seed);
void boxes(uint32_t seed);

}  // namespace stress
