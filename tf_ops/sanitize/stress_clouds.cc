// Sampling, ball query, nearest neighbours.

#include <algorithm>
#include <cmath>
#include <limits>

#include "sanitize/stress.h"

namespace stress {
namespace {

using ptn::Clouds;

// Points on a lattice tie often; squared distances of huge ones overflow.
enum class Kind { random, lattice, huge };

std::vector<float> cloud(int64_t points, Kind kind, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<float> xyz = normal(3 * points, &random, 3.0F);
  for (float& value : xyz) {
    if (kind == Kind::lattice) value = std::round(value);
    if (kind == Kind::huge) value *= 1e30F;
  }
  return xyz;
}

float distance2(const float* a, const float* b) {
  const float x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return (x * x + y * y) + z * z;
}

struct Found {
  std::vector<int32_t> sampled, ball, count, three, few, many;
  std::vector<float> three2, few2, many2;

  bool operator==(const Found& o) const {
    return sampled == o.sampled && ball == o.ball && count == o.count && three == o.three &&
           few == o.few && many == o.many && three2 == o.three2 && few2 == o.few2 &&
           many2 == o.many2;
  }
};

constexpr int32_t kSamples = 40, kBall = 8, kThree = 3, kFewest = 5, kMost = 33;
constexpr float kRadius = 1.5F;

Found run_all(const Kernels& set, Clouds points, Clouds queries, const Parallel& threads) {
  const size_t rows = static_cast<size_t>(queries.batch * queries.size);
  Found f;
  f.sampled.resize(static_cast<size_t>(points.batch * kSamples));
  f.ball.resize(rows * kBall);
  f.count.resize(rows);
  const auto nearest = [&](int32_t k, std::vector<int32_t>* index, std::vector<float>* dist2) {
    index->resize(rows * k);
    dist2->resize(rows * k);
    set.knn_point(points, queries, k, dist2->data(), index->data(), threads);
  };
  nearest(kThree, &f.three, &f.three2);
  nearest(kFewest, &f.few, &f.few2);
  nearest(kMost, &f.many, &f.many2);
  set.farthest_point_sample(points, kSamples, f.sampled.data(), threads);
  set.query_ball_point(points, queries, kRadius, kBall, f.ball.data(), f.count.data(), threads);
  return f;
}

// Farthest points of each cloud, one after the other: the lowest index among ties, 0 when none is
// left.
void check_samples(const Found& f, Clouds points, const char* name) {
  for (int64_t b = 0; b < points.batch; ++b) {
    const float* cloud = points.xyz + b * points.size * 3;
    std::vector<float> left(static_cast<size_t>(points.size),
                            std::numeric_limits<float>::infinity());
    int64_t farthest = 0;
    for (int32_t s = 0; s < kSamples; ++s) {
      expect(f.sampled[b * kSamples + s] == farthest, name, "sampling", points.size);
      for (int64_t i = 0; i < points.size; ++i) {
        left[i] = std::min(left[i], distance2(cloud + 3 * i, cloud + 3 * farthest));
      }
      farthest = std::max_element(left.begin(), left.end()) - left.begin();
    }
  }
}

// The first points in each ball, or the nearest, found by looking at all of them.
void check_balls(const Found& f, Clouds points, Clouds queries, const char* name) {
  for (int64_t row = 0; row < queries.batch * queries.size; ++row) {
    const float* cloud = points.xyz + row / queries.size * points.size * 3;
    std::vector<int32_t> inside;
    int32_t nearest = 0;
    const auto away = [=](int32_t i) { return distance2(cloud + 3 * i, queries.xyz + 3 * row); };
    for (int32_t i = 0; i < points.size; ++i) {
      if (away(i) < kRadius * kRadius && inside.size() < kBall) inside.push_back(i);
      if (away(i) < away(nearest)) nearest = i;
    }
    const auto count = static_cast<int32_t>(inside.size());
    expect(f.count[row] == count, name, "ball query, count", points.size);
    inside.resize(kBall, count > 0 ? inside[0] : nearest);
    const bool same = std::equal(inside.begin(), inside.end(), f.ball.begin() + row * kBall);
    expect(same, name, "ball query", points.size);
  }
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
      expect(f.many2[row * kMost + k] == expected.first, name, "knn, distances", points.size);
      if (k < kThree) {
        expect(f.three[row * kThree + k] == expected.second, name, "three_nn", points.size);
      }
      if (k < kFewest) {
        expect(f.few[row * kFewest + k] == expected.second, name, "knn, few", points.size);
      }
    }
  }
}

}  // namespace

void clouds(const Sets& sets, uint32_t seed) {
  for (const int64_t size : {1, 15, 16, 33, 300, 1100, 2048}) {
    for (const Kind kind : {Kind::random, Kind::lattice, Kind::huge}) {
      for (const int64_t batch : {1, 3}) {
        const auto a = cloud(batch * size, kind, seed);
        const auto b = cloud(batch * 37, kind, seed + 1);
        const Clouds points = {a.data(), batch, size}, queries = {b.data(), batch, 37};
        const Found first = run_all(*sets[0], points, queries, ptn::serial());
        check_samples(first, points, sets[0]->name);
        check_balls(first, points, queries, sets[0]->name);
        check_neighbours(first, points, queries, sets[0]->name);
        for (const Kernels* set : sets) {
          for (const int threads : {3, 70}) {  // 70: more than the leaves of a tree
            const Found found = run_all(*set, points, queries, real_threads(threads));
            expect(found == first, set->name, "an op", size);
          }
        }
      }
    }
  }
}

}  // namespace stress
