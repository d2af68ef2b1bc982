// Gather of feature rows and its transpose, the scattered sum; independent of TensorFlow. T is any
// type that converts to and from float.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "core/parallel.h"
#include "core/prefetch.h"

namespace ptn {

// Sizes of a gather: `batch` times, `entries` rows chosen among `rows` rows of `channels` values.
struct RowSizes {
  int64_t batch, rows, entries, channels;
};

// out[b, e] = source[b, index[b, e]]. Indices must be in range.
template <class T>
void gather_rows(const T* source, const int32_t* index, RowSizes s, T* out,
                 const Parallel& parallel) {
  constexpr int64_t kAhead = 8;  // rows to prefetch, known from the index
  const size_t bytes = static_cast<size_t>(s.channels) * sizeof(T);
  if (bytes == 0) return;
  const int64_t cost = 4 + static_cast<int64_t>(bytes) / 8;
  parallel.run(s.batch * s.entries, cost, [=](int64_t begin, int64_t end) {
    const auto row = [=](int64_t e) {
      return source + (e / s.entries * s.rows + index[e]) * s.channels;
    };
    for (int64_t e = begin; e < end; ++e) {
      if (e + kAhead < end) prefetch_row(row(e + kAhead), bytes);
      std::memcpy(out + e * s.channels, row(e), bytes);
    }
  });
}

// The channels of one entry of a scattered sum: sum += weight * value.
template <class T>
inline void add_row(const T* __restrict value, float weight, int64_t channels,
                    float* __restrict sum) {
  for (int64_t c = 0; c < channels; ++c) sum[c] += weight * static_cast<float>(value[c]);
}

// out[b, r] = sum of weight[b, e] * value[b, e / fan] over the entries e with index[b, e] = r, in
// ascending order of e and in float32, whatever T and the number of threads. No `weight`: all 1.
// Each thread owns a range of the sums, so no synchronisation is needed.
template <class T>
void scatter_rows(const T* value, const int32_t* index, const float* weight, int64_t fan,
                  RowSizes s, T* out, const Parallel& parallel) {
  const int64_t parts =
      s.batch >= parallel.threads ? 1 : std::min<int64_t>(parallel.threads, s.rows);
  const int64_t cost = 10 + s.entries * (1 + s.channels / 4) / std::max<int64_t>(parts, 1);
  parallel.run(s.batch * parts, cost, [=](int64_t first, int64_t last) {
    std::vector<float> converted;
    for (int64_t task = first; task < last; ++task) {
      const int64_t b = task / parts, part = task % parts;
      const int64_t begin = s.rows * part / parts, end = s.rows * (part + 1) / parts;
      T* owned = out + (b * s.rows + begin) * s.channels;
      const int64_t size = (end - begin) * s.channels;
      float* sums;
      if constexpr (std::is_same_v<T, float>) {
        sums = owned;
        std::fill_n(sums, size, 0.0F);
      } else {
        converted.assign(static_cast<size_t>(size), 0.0F);
        sums = converted.data();
      }
      const int64_t base = b * s.entries;
      for (int64_t e = 0; e < s.entries; ++e) {
        const int64_t row = index[base + e];
        if (row < begin || row >= end) continue;
        add_row(value + (base + e) / fan * s.channels, weight == nullptr ? 1.0F : weight[base + e],
                s.channels, sums + (row - begin) * s.channels);
      }
      if constexpr (!std::is_same_v<T, float>) {
        for (int64_t i = 0; i < size; ++i) owned[i] = static_cast<T>(sums[i]);
      }
    }
  });
}

}  // namespace ptn
