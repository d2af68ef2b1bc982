// k nearest neighbours, and the k smallest of rows.
//
// To be included inside the namespace of one instruction set, after nearest.h.

constexpr int32_t kSmallK = 16;  // up to here an always sorted list is the faster container

template <class Keys>
void knn_of_queries(const std::vector<std::unique_ptr<KdTree>>& trees, const Clouds& queries,
                    int32_t k, float* dist2, int32_t* index, int64_t begin, int64_t end) {
  Keys keys(k);
  for (int64_t row = begin; row < end; ++row) {
    const KdTree& tree = *trees[row / queries.size];
    keys.clear();
    gather_nearest(tree, Query(queries.xyz + 3 * row), tree.top(), 0, keys);
    const Key* found = keys.finish();
    for (int32_t i = 0; i < k; ++i) {
      const Key key = found[i] < kFarthest ? found[i] : found[0];
      dist2[row * k + i] = distance_of(key);
      index[row * k + i] = index_of(key);
    }
  }
}

inline void knn_point(Clouds clouds, Clouds queries, int32_t k, float* dist2, int32_t* index,
                      const Parallel& parallel) {
  const auto trees = build_trees(clouds, 1, parallel);
  parallel.run(queries.batch * queries.size, 200 + 50 * int64_t{k},
               [&](int64_t begin, int64_t end) {
                 const auto run = k <= kSmallK ? knn_of_queries<SortedKeys>
                                               : knn_of_queries<BufferedKeys>;
                 run(trees, queries, k, dist2, index, begin, end);
               });
}

// The bits of a float as an unsigned number of the same order; -0 and 0 are equal.
inline uint32_t ordered_bits(float value) {
  value += 0.0F;
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof(bits));
  return bits & 0x80000000U ? ~bits : bits | 0x80000000U;
}

inline void select_top_k(const float* values, int64_t rows, int64_t columns, int32_t k,
                         float* smallest, int32_t* index, const Parallel& parallel) {
  parallel.run(rows, 2 * columns + 50 * int64_t{k}, [&](int64_t begin, int64_t end) {
    const int64_t kept = std::min<int64_t>(k, columns);
    std::vector<Key> keys(static_cast<size_t>(columns));
    for (int64_t row = begin; row < end; ++row) {
      const float* value = values + row * columns;
      for (int64_t i = 0; i < columns; ++i) {
        keys[i] = make_key(ordered_bits(value[i]), static_cast<int32_t>(i));
      }
      std::nth_element(keys.begin(), keys.begin() + kept - 1, keys.end());
      std::sort(keys.begin(), keys.begin() + kept);
      for (int64_t i = 0; i < k; ++i) {
        const int32_t chosen = index_of(keys[i < kept ? i : 0]);
        index[row * k + i] = chosen;
        smallest[row * k + i] = value[chosen];
      }
    }
  });
}
