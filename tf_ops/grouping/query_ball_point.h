// Ball query: the first points, in index order, within a radius.
#pragma once

#include "core/isa.h"
#include "grouping/nearest_few.h"

namespace ptn::PTN_ISA {

// A set of indices below a limit that is read in order: a bit per index, and a bit per used word.
class IndexSet {
 public:
  explicit IndexSet(int64_t limit)
      : words_(static_cast<size_t>((limit + 63) / 64)), used_((words_.size() + 63) / 64) {}

  void add(int32_t index) {
    const uint32_t i = static_cast<uint32_t>(index);
    words_[i / 64] |= uint64_t{1} << (i % 64);
    used_[i / 4096] |= uint64_t{1} << (i / 64 % 64);
  }

  // Writes the lowest indices, at most `most`, and empties the set. Returns their number.
  int32_t take(int32_t most, int32_t* out) {
    int32_t taken = 0;
    for (size_t u = 0; u < used_.size(); ++u) {
      for (; used_[u] != 0; used_[u] &= used_[u] - 1) {
        const size_t w = u * 64 + static_cast<size_t>(__builtin_ctzll(used_[u]));
        for (; words_[w] != 0 && taken < most; words_[w] &= words_[w] - 1) {
          out[taken++] = static_cast<int32_t>(w * 64) + __builtin_ctzll(words_[w]);
        }
        words_[w] = 0;
      }
    }
    return taken;
  }

 private:
  std::vector<uint64_t> words_, used_;
};

inline void gather_ball(const KdTree& tree, const Point16& q, float radius2, int level, int64_t g,
                        IndexSet& inside) {
  for_each_lane(bits(tree.group(level, g).distance2_to(q) < all(radius2)), [&](int i) {
    const int64_t node = g * kWidth + i;
    if (level > 0) return gather_ball(tree, q, radius2, level - 1, node, inside);
    for (int b = 0; b < tree.leaf_blocks(); ++b) {
      const int64_t block = node * tree.leaf_blocks() + b;
      for_each_lane(bits(distance2(tree.points(block), q) < all(radius2)),
                    [&](int lane) { inside.add(tree.index(block)[lane]); });
    }
  });
}

inline void query_ball_point(Clouds clouds, Clouds queries, float radius, int32_t nsample,
                             int32_t* index, int32_t* count, const Parallel& parallel) {
  const auto trees = build_trees(clouds, 1, parallel);
  const float radius2 = radius * radius;
  parallel.run(queries.batch * queries.size, 1000, [&](int64_t begin, int64_t end) {
    IndexSet inside(clouds.size);
    for (int64_t row = begin; row < end; ++row) {
      const KdTree& tree = *trees[row / queries.size];
      const float* query = queries.xyz + 3 * row;
      int32_t* out = index + row * nsample;
      gather_ball(tree, all_point(query), radius2, tree.top(), 0, inside);
      count[row] = inside.take(nsample, out);
      const int32_t fill = count[row] > 0 ? out[0] : Nearest::find(tree, query);
      std::fill(out + count[row], out + nsample, fill);
    }
  });
}

}  // namespace ptn::PTN_ISA
