// Runs every algorithm, in every instruction set that this processor has, from several threads at
// once and over real threads, and compares with brute force. Built with sanitizers and without
// TensorFlow, so that the thread sanitizer sees all of the synchronisation.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <thread>
#include <vector>

#include "boxes/rotated.h"
#include "core/all_kernels.h"
#include "core/rows.h"
#include "interpolation/three_interpolate.h"

namespace {

using ptn::Clouds;
using ptn::Kernels;
using ptn::Parallel;

std::atomic<int> failures{0};

void expect(bool good, const char* set, const char* what, int64_t size) {
  if (good) return;
  ++failures;
  std::fprintf(stderr, "%s: %s differs at size %lld\n", set, what, static_cast<long long>(size));
}

// A thread for each part of the work.
Parallel real_threads(int threads) {
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

std::vector<float> random_cloud(int64_t points, bool lattice, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0, 3);
  std::vector<float> xyz(static_cast<size_t>(3 * points));
  for (float& value : xyz) value = lattice ? std::round(normal(random)) : normal(random);
  return xyz;
}

float distance2(const float* a, const float* b) {
  const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return (x * x + y * y) + z * z;
}

struct Found {
  std::vector<int32_t> sampled, ball, count, few, many;
  std::vector<float> few2, many2;

  bool operator==(const Found& o) const {
    return sampled == o.sampled && ball == o.ball && count == o.count && few == o.few &&
           many == o.many && few2 == o.few2 && many2 == o.many2;
  }
};

constexpr int32_t kSamples = 40, kBall = 8, kFewest = 5, kMost = 33;

Found run_all(const Kernels& set, Clouds points, Clouds queries, const Parallel& threads) {
  const size_t rows = static_cast<size_t>(queries.batch * queries.size);
  Found f;
  f.sampled.resize(static_cast<size_t>(points.batch * kSamples));
  f.ball.resize(rows * kBall);
  f.count.resize(rows);
  f.few.resize(rows * kFewest);
  f.few2.resize(rows * kFewest);
  f.many.resize(rows * kMost);
  f.many2.resize(rows * kMost);
  set.farthest_point_sample(points, kSamples, f.sampled.data(), threads);
  set.query_ball_point(points, queries, 1.5F, kBall, f.ball.data(), f.count.data(), threads);
  set.knn_point(points, queries, kFewest, f.few2.data(), f.few.data(), threads);
  set.knn_point(points, queries, kMost, f.many2.data(), f.many.data(), threads);
  return f;
}

// The nearest neighbours of each query by sorting all distances.
void check_neighbours(const Found& f, Clouds points, Clouds queries, const char* name) {
  for (int64_t row = 0; row < queries.batch * queries.size; ++row) {
    const float* cloud = points.xyz + row / queries.size * points.size * 3;
    std::vector<std::pair<float, int32_t>> order;
    for (int32_t i = 0; i < points.size; ++i) {
      order.emplace_back(distance2(cloud + 3 * i, queries.xyz + 3 * row), i);
    }
    std::sort(order.begin(), order.end());
    for (int32_t k = 0; k < kMost; ++k) {
      const auto& expected = order[k < points.size ? k : 0];
      expect(f.many[row * kMost + k] == expected.second, name, "knn, many", points.size);
      if (k < kFewest) {
        expect(f.few[row * kFewest + k] == expected.second, name, "knn, few", points.size);
      }
    }
  }
}

void stress_clouds(const std::vector<const Kernels*>& sets, uint32_t seed) {
  for (const int64_t size : {1, 15, 16, 33, 300, 1100}) {
    for (const bool lattice : {false, true}) {
      for (const int64_t batch : {1, 3}) {
        const auto a = random_cloud(batch * size, lattice, seed);
        const auto b = random_cloud(batch * 37, lattice, seed + 1);
        const Clouds points = {a.data(), batch, size}, queries = {b.data(), batch, 37};
        const Found first = run_all(*sets[0], points, queries, ptn::serial());
        check_neighbours(first, points, queries, sets[0]->name);
        for (const Kernels* set : sets) {
          const Found found = run_all(*set, points, queries, real_threads(3));
          expect(found == first, set->name, "an op", size);
        }
      }
    }
  }
}

void stress_rows(uint32_t seed) {
  std::mt19937 random(seed);
  const ptn::RowSizes sizes = {2, 50, 90, 19};
  std::vector<float> points(2 * 50 * 19), out(2 * 90 * 19), grad(points.size());
  std::vector<float> again(points.size()), weight(2 * 30 * 3), weight_grad(weight.size());
  std::vector<int32_t> index(2 * 90);
  for (float& p : points) p = static_cast<float>(random() % 100);
  for (float& w : weight) w = static_cast<float>(random() % 10);
  for (int32_t& i : index) i = static_cast<int32_t>(random() % 50);
  ptn::gather_rows(points.data(), index.data(), sizes, out.data(), real_threads(3));
  for (const int threads : {1, 2, 5}) {
    auto& sums = threads == 1 ? grad : again;
    ptn::scatter_rows(out.data(), index.data(), nullptr, 1, sizes, sums.data(),
                      real_threads(threads));
    expect(threads == 1 || again == grad, "rows", "scatter_rows", threads);
  }
  const ptn::RowSizes dense = {2, 50, 30, 19};
  ptn::interpolate_rows(points.data(), index.data(), weight.data(), dense, out.data(),
                        real_threads(3));
  ptn::interpolation_weight_grad(points.data(), index.data(), out.data(), dense,
                                 weight_grad.data(), real_threads(3));
  expect(weight_grad[0] >= 0, "rows", "interpolation_weight_grad", 0);
}

void stress_boxes(uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0, 4);
  std::vector<float> values(60 * ptn::kBoxSize), scores(60);
  for (float& v : values) v = uniform(random);
  for (float& s : scores) s = uniform(random);
  const auto boxes = ptn::read_boxes(values.data(), 60);
  for (const auto& a : boxes) {
    for (const auto& b : boxes) {
      const double iou = ptn::iou_3d(a, b);
      expect(iou >= 0 && iou <= 1 && std::abs(iou - ptn::iou_3d(b, a)) < 1e-9, "boxes", "iou", 0);
    }
  }
  expect(!ptn::suppress(boxes, scores.data(), 0.1, 10).empty(), "boxes", "suppress", 60);
}

}  // namespace

int main() {
  const std::vector<const Kernels*> sets = ptn::all_kernels();
  std::vector<std::thread> callers;
  for (uint32_t caller = 0; caller < 3; ++caller) {
    callers.emplace_back([&sets, caller] {
      stress_clouds(sets, caller);
      stress_rows(caller);
      stress_boxes(caller);
    });
  }
  for (std::thread& caller : callers) caller.join();
  for (const Kernels* set : sets) std::printf("%s ", set->name);
  std::printf(failures == 0 ? "agree\n" : "DIFFER\n");
  return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
