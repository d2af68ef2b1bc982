// Points as four arrays, and the division of a range of them at a median of its longest side, the
// step of a k-d order.
#pragma once

#include "core/aligned.h"
#include "core/isa.h"
#include "core/simd.h"

namespace ptn::PTN_ISA {

constexpr int kWidth = 16;
constexpr int32_t kNoPoint = std::numeric_limits<int32_t>::max();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

inline int64_t divide_up(int64_t a, int64_t b) { return (a + b - 1) / b; }

// Points in blocks of sixteen; unused places lie at infinity and have index kNoPoint.
struct PointArrays {
  int64_t blocks;
  AlignedArray<float> axis[3];
  AlignedArray<int32_t> index;

  explicit PointArrays(int64_t room)  // a multiple of kWidth
      : blocks(room / kWidth),
        axis{AlignedArray<float>(room), AlignedArray<float>(room), AlignedArray<float>(room)},
        index(room) {}

  void fill(const float* xyz, int64_t size) {
    for (int64_t i = 0; i < size; ++i) {
      for (int a = 0; a < 3; ++a) axis[a][i] = xyz[3 * i + a];
      index[i] = static_cast<int32_t>(i);
    }
    for (int64_t i = size; i < blocks * kWidth; ++i) {
      for (int a = 0; a < 3; ++a) axis[a][i] = kInfinity;
      index[i] = kNoPoint;
    }
  }

  Point16 points(int64_t block) const {
    const int64_t i = block * kWidth;
    return {load(&axis[0][i]), load(&axis[1][i]), load(&axis[2][i])};
  }
};

struct Bounds {
  float low[3], high[3];

  int longest() const {
    const float e[3] = {high[0] - low[0], high[1] - low[1], high[2] - low[2]};
    return e[0] >= e[1] ? (e[0] >= e[2] ? 0 : 2) : (e[1] >= e[2] ? 1 : 2);
  }
};

// The box around the points of blocks [begin, end).
inline Bounds bounds_of(const PointArrays& points, int64_t begin, int64_t end) {
  Bounds bounds;
  for (int a = 0; a < 3; ++a) {
    F16 low = all(kInfinity), high = all(-kInfinity);
    for (int64_t b = begin; b < end; ++b) {
      const F16 at = load(&points.axis[a][b * kWidth]);
      low = min(low, at);
      high = max(high, select(at < all(kInfinity), at, all(-kInfinity)));
    }
    bounds.low[a] = -largest(all(0.0F) - low);
    bounds.high[a] = largest(high);
  }
  return bounds;
}

// The number of values that are at most `limit`; `values` fill whole blocks.
inline int64_t count_up_to(const float* values, int64_t blocks, float limit) {
  int64_t count = 0;
  const F16 limits = all(limit);
  for (int64_t b = 0; b < blocks; ++b) {
    count += __builtin_popcount(bits(load(values + b * kWidth) <= limits));
  }
  return count;
}

// A value up to which there are at least `least` and at most `most` others, least <= most. Where
// ties allow none, the value of rank `least`. `low` and `high` bound the values.
inline float threshold(const float* values, int64_t blocks, int64_t least, int64_t most, float low,
                       float high) {
  if (count_up_to(values, blocks, low) >= least) return low;
  int64_t below = 0, above = blocks * kWidth;  // counts up to low and high, the first is a guess
  for (bool interpolate = true;; interpolate = !interpolate) {
    const float share =
        static_cast<float>((least + most) / 2 - below) / static_cast<float>(above - below);
    float middle = interpolate ? low + (high - low) * share : 0.5F * low + 0.5F * high;
    if (!(low < middle && middle < high)) {
      middle = 0.5F * low + 0.5F * high;
      if (!(low < middle && middle < high)) return high;
    }
    const int64_t count = count_up_to(values, blocks, middle);
    if (least <= count && count <= most) return middle;
    if (count < least) {
      low = middle;
      below = count;
    } else {
      high = middle;
      above = count;
    }
  }
}

// Reorders blocks [begin, end) so that the `lower` points with the smallest coordinates come first.
// `scratch` has the same room as `points`; only the same blocks of it are used.
inline void divide(PointArrays& points, PointArrays& scratch, int64_t begin, int64_t end,
                   int64_t lower, const Bounds& bounds) {
  const int cut = bounds.longest();
  const F16 value = all(threshold(&points.axis[cut][begin * kWidth], end - begin, lower, lower,
                                  bounds.low[cut], bounds.high[cut]));
  int64_t to_lower = begin * kWidth, to_upper = begin * kWidth, equal_room = lower;
  for (int64_t b = begin; b < end; ++b) {
    equal_room -= __builtin_popcount(bits(load(&points.axis[cut][b * kWidth]) < value));
  }
  for (int64_t b = begin; b < end; ++b) {
    const F16 at = load(&points.axis[cut][b * kWidth]);
    Mask equal = bits(at == value);
    const int64_t equals = __builtin_popcount(equal);
    for (int64_t spare = equals - equal_room; spare > 0; --spare) equal &= equal - 1;
    equal_room -= std::min(equals, equal_room);
    const Mask chosen = bits(at < value) | equal;
    const Mask rest = ~chosen & 0xFFFFU;
    for (int a = 0; a < 3; ++a) {
      const F16 lanes = load(&points.axis[a][b * kWidth]);
      compress(&points.axis[a][to_lower], lanes, chosen);
      compress(&scratch.axis[a][to_upper], lanes, rest);
    }
    const I16 lanes = load(&points.index[b * kWidth]);
    compress(&points.index[to_lower], lanes, chosen);
    compress(&scratch.index[to_upper], lanes, rest);
    to_lower += __builtin_popcount(chosen);
    to_upper += __builtin_popcount(rest);
  }
  const size_t bytes = static_cast<size_t>(to_upper - begin * kWidth) * 4;
  for (int a = 0; a < 3; ++a) {
    std::memcpy(&points.axis[a][to_lower], &scratch.axis[a][begin * kWidth], bytes);
  }
  std::memcpy(&points.index[to_lower], &scratch.index[begin * kWidth], bytes);
}

}  // namespace ptn::PTN_ISA
