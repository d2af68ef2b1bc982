// k nearest neighbours.
#pragma once

#include "core/isa.h"
#include "grouping/nearest_few.h"
#include "grouping/nearest_many.h"

namespace ptn::PTN_ISA {

using Trees = std::vector<std::unique_ptr<KdTree>>;

// Small k: the queries get trees of their own, whose leaves are sixteen neighbouring queries.
inline void knn_few(const Trees& trees, Clouds queries, int32_t k, float* dist2, int32_t* index,
                    const Parallel& parallel) {
  const Trees query_trees = build_trees(queries, 1, parallel);
  const int64_t blocks = query_trees[0]->leaves();
  const auto run = k <= 1   ? few_nearest<1>
                   : k <= 3 ? few_nearest<3>
                   : k <= 4 ? few_nearest<4>
                   : k <= 8 ? few_nearest<8>
                            : few_nearest<kFew>;
  parallel.run(queries.batch * blocks, 1000 + 200 * int64_t{k}, [&](int64_t begin, int64_t end) {
    while (begin < end) {
      const int64_t b = begin / blocks, stop = std::min(end, (b + 1) * blocks);
      const int64_t out = b * queries.size * k;
      run(*trees[b], *query_trees[b], k, dist2 + out, index + out, begin - b * blocks,
          stop - b * blocks);
      begin = stop;
    }
  });
}

inline void knn_many(const Trees& trees, Clouds queries, int32_t k, float* dist2, int32_t* index,
                     const Parallel& parallel) {
  parallel.run(queries.batch * queries.size, 500 + 20 * int64_t{k},
               [&](int64_t begin, int64_t end) {
                 ManyNearest nearest(k);
                 for (int64_t row = begin; row < end; ++row) {
                   nearest.find(*trees[row / queries.size], queries.xyz + 3 * row, dist2 + row * k,
                                index + row * k);
                 }
               });
}

inline void knn_point(Clouds clouds, Clouds queries, int32_t k, float* dist2, int32_t* index,
                      const Parallel& parallel) {
  const bool few = k <= kFew;
  const Trees trees = build_trees(clouds, few ? 1 : kManyLeafBlocks, parallel);
  const auto run = few ? knn_few : knn_many;
  run(trees, queries, k, dist2, index, parallel);
}

}  // namespace ptn::PTN_ISA
