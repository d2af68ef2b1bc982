// Rows of features: gather, scattered sum, interpolation and its gradient.

#include <algorithm>
#include <cmath>

#include "core/rows.h"
#include "interpolation/three_interpolate.h"
#include "sanitize/stress.h"

namespace stress {
namespace {

constexpr ptn::RowSizes kSizes = {2, 50, 90, 19};
constexpr int64_t kThirds = 30;  // kSizes.entries / 3

// Whole numbers: sums are exact in any order. T: float, and a type that needs conversion.
template <class T>
void gather_and_scatter(const std::vector<int32_t>& index, std::mt19937* random) {
  const ptn::RowSizes s = kSizes;
  std::vector<T> points(static_cast<size_t>(s.batch * s.rows * s.channels));
  for (T& p : points) p = static_cast<T>((*random)() % 100);
  std::vector<T> out(static_cast<size_t>(s.batch * s.entries * s.channels));
  ptn::gather_rows(points.data(), index.data(), s, out.data(), real_threads(3));
  std::vector<T> sums(points.size(), T{0}), found(points.size());
  for (int64_t e = 0; e < s.batch * s.entries; ++e) {
    const int64_t row = e / s.entries * s.rows + index[e];
    for (int64_t c = 0; c < s.channels; ++c) {
      expect(out[e * s.channels + c] == points[row * s.channels + c], "rows", "gather_rows", e);
      sums[row * s.channels + c] += out[e * s.channels + c];
    }
  }
  for (const int threads : {1, 2, 5}) {
    ptn::scatter_rows(out.data(), index.data(), nullptr, 1, s, found.data(), real_threads(threads));
    expect(found == sums, "rows", "scatter_rows", threads);
  }
}

template <class T>
void interpolate(const std::vector<int32_t>& index, std::mt19937* random) {
  const ptn::RowSizes s = {kSizes.batch, kSizes.rows, kThirds, kSizes.channels};
  const int64_t queries = s.batch * s.entries;
  std::vector<T> points(static_cast<size_t>(s.batch * s.rows * s.channels));
  for (T& p : points) p = static_cast<T>((*random)() % 100);
  std::vector<float> weight(static_cast<size_t>(3 * queries)), grad(weight.size());
  for (float& w : weight) w = static_cast<float>((*random)() % 10);
  std::vector<T> out(static_cast<size_t>(queries * s.channels));
  ptn::interpolate_rows(points.data(), index.data(), weight.data(), s, out.data(), real_threads(3));
  ptn::interpolation_weight_grad(points.data(), index.data(), out.data(), s, grad.data(),
                                 real_threads(3));
  for (int64_t q = 0; q < queries; ++q) {
    double slope[3] = {};
    for (int64_t c = 0; c < s.channels; ++c) {
      double sum = 0;
      for (int64_t k = 0; k < 3; ++k) {
        const int64_t row = q / s.entries * s.rows + index[3 * q + k];
        const double point = static_cast<double>(points[row * s.channels + c]);
        sum += static_cast<double>(weight[3 * q + k]) * point;
        slope[k] += static_cast<double>(out[q * s.channels + c]) * point;
      }
      const double found = static_cast<double>(out[q * s.channels + c]);
      expect(found == sum, "rows", "interpolate_rows", q);
    }
    for (int64_t k = 0; k < 3; ++k) {
      const double off = std::abs(static_cast<double>(grad[3 * q + k]) - slope[k]);
      expect(off <= 1e-5 * slope[k], "rows", "interpolation_weight_grad", q);
    }
  }
}

// Group difference in all instruction sets and over threads, against a plain loop.
void difference(const Sets& sets, const std::vector<int32_t>& index, std::mt19937* random) {
  const ptn::RowSizes s = kSizes;
  const auto points = normal(s.batch * s.rows * s.channels, random);
  const auto query = normal(s.batch * kThirds * s.channels, random);
  for (const int64_t pairs : {0, 1, 2}) {
    const auto pair = normal(s.batch * s.entries * pairs, random);
    const auto weight = normal(pairs * s.channels, random);
    for (const bool relu : {false, true}) {
      const ptn::GroupDifference work = {
          s.batch,      s.rows,       s.channels,  kThirds,       3,   pairs, points.data(),
          index.data(), query.data(), pair.data(), weight.data(), relu};
      std::vector<float> expected, found(static_cast<size_t>(s.batch * s.entries * s.channels));
      for (int64_t i = 0; i < s.batch * s.entries * s.channels; ++i) {
        const int64_t e = i / s.channels, c = i % s.channels;
        const int64_t row = e / s.entries * s.rows + index[e];
        float value = points[row * s.channels + c] - query[e / 3 * s.channels + c];
        for (int64_t p = 0; p < pairs; ++p) {
          value += pair[e * pairs + p] * weight[p * s.channels + c];
        }
        expected.push_back(relu ? std::max(value, 0.0F) : value);
      }
      for (const Kernels* set : sets) {
        set->group_difference(work, found.data(), real_threads(3));
        expect(found == expected, set->name, "group_difference", pairs);
      }
    }
  }
}

}  // namespace

void rows(const Sets& sets, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<int32_t> index(static_cast<size_t>(kSizes.batch * kSizes.entries));
  for (int32_t& i : index) i = static_cast<int32_t>(random() % kSizes.rows);
  gather_and_scatter<float>(index, &random);
  gather_and_scatter<double>(index, &random);
  interpolate<float>(index, &random);
  interpolate<double>(index, &random);
  difference(sets, index, &random);
}

}  // namespace stress
