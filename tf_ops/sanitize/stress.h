// What the parts of the stress program share: real threads, and the count of failures.
#pragma once

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <random>
#include <thread>
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

// A thread for each part of the work.
inline Parallel real_threads(int threads) {
  return {[threads](int64_t total, int64_t, const ptn::Body& body) {
            std::vector<std::thread> running;
            for (int i = 0; i < threads; ++i) {
              const int64_t begin = total * i / threads, end = total * (i + 1) / threads;
              if (begin < end) running.emplace_back([=, &body] { body(begin, end); });
            }
            for (std::thread& thread : running) thread.join();
          },
          threads};
}

inline std::vector<float> normal(int64_t size, std::mt19937* random, float deviation = 1.0F) {
  std::normal_distribution<float> distribution(0, deviation);
  std::vector<float> values(static_cast<size_t>(size));
  for (float& value : values) value = distribution(*random);
  return values;
}

// Each compares an algorithm in all instruction sets and over threads with plain loops.
void clouds(const Sets& sets, uint32_t seed);
void normalization(const Sets& sets, uint32_t seed);
void rows(uint32_t seed);
void boxes(uint32_t seed);

}  // namespace stress
