// The first linear layer of a neighbourhood from precomputed products: gather, subtract, add.
#pragma once

#include "core/isa.h"

namespace ptn::PTN_ISA {

inline void difference_row(const float* __restrict source, const float* __restrict query,
                           int64_t channels, float* __restrict out) {
  for (int64_t c = 0; c < channels; ++c) out[c] = source[c] - query[c];
}

inline void add_pair_row(const float* __restrict weight, float pair, int64_t channels,
                         float* __restrict out) {
  for (int64_t c = 0; c < channels; ++c) out[c] += pair * weight[c];
}

// NaN stays NaN.
inline void relu_row(int64_t channels, float* out) {
  for (int64_t c = 0; c < channels; ++c) out[c] = 0.0F > out[c] ? 0.0F : out[c];
}

// out (batch, queries, neighbours, channels); see GroupDifference in kernels.h.
inline void group_difference(const GroupDifference& g, float* out, const Parallel& parallel) {
  constexpr int64_t kAhead = 8;  // rows to prefetch, known from the index
  const int64_t cost = g.neighbours * (4 + (2 + g.pairs) * g.channels / 8);
  parallel.run(g.batch * g.queries, cost, [&, out](int64_t begin, int64_t end) {
    const auto source = [&](int64_t entry) {
      const int64_t cloud = entry / (g.queries * g.neighbours);
      return g.points + (cloud * g.size + g.index[entry]) * g.channels;
    };
    const int64_t last = end * g.neighbours;
    for (int64_t q = begin; q < end; ++q) {
      for (int64_t e = q * g.neighbours; e < (q + 1) * g.neighbours; ++e) {
        if (e + kAhead < last) {
          prefetch_row(source(e + kAhead), static_cast<size_t>(g.channels) * sizeof(float));
        }
        float* row = out + e * g.channels;
        difference_row(source(e), g.query + q * g.channels, g.channels, row);
        for (int64_t p = 0; p < g.pairs; ++p) {
          add_pair_row(g.weight + p * g.channels, g.pair[e * g.pairs + p], g.channels, row);
        }
        if (g.relu) relu_row(g.channels, row);
      }
    }
  });
}

}  // namespace ptn::PTN_ISA
