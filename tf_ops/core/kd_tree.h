// A balanced k-d tree, sixteen children wide: blocks of sixteen points at the bottom, groups of
// sixteen bounding boxes above. One comparison of a whole group selects the relevant children.
//
// Bounds are exact in float32. A point's squared distance and the distance to a box that holds it
// are computed with the same operations; rounding is monotonic, so the box's is never the larger.
// Pruning therefore changes no result, not even among ties.
#pragma once

#include "core/isa.h"
#include "core/kd_order.h"

namespace ptn::PTN_ISA {

// Sixteen bounding boxes; unused places are empty boxes, infinitely far from anything.
struct alignas(64) Group {
  float low[3][kWidth], high[3][kWidth];

  Group() {
    std::fill_n(low[0], 3 * kWidth, kInfinity);
    std::fill_n(high[0], 3 * kWidth, -kInfinity);
  }

  void set(int64_t place, const Bounds& bounds) {
    for (int a = 0; a < 3; ++a) {
      low[a][place] = bounds.low[a];
      high[a][place] = bounds.high[a];
    }
  }

  // Squared distance from a point to each box, 0 inside: a lower bound for all points in it.
  F16 distance2_to(const Point16& q) const { return distance2_to(q, q); }

  // The same between these boxes and the box from `from` to `to`.
  F16 distance2_to(const Point16& from, const Point16& to) const {
    return squared(gap(from.x, to.x, 0), gap(from.y, to.y, 1), gap(from.z, to.z, 2));
  }

 private:
  F16 gap(F16 from, F16 to, int a) const {
    return max(max(load(low[a]) - to, from - load(high[a])), all(0.0F));
  }
};

class KdTree {
 public:
  // Builds over `size` >= 1 points, `leaf_blocks` blocks to a leaf.
  KdTree(const float* xyz, int64_t size, int leaf_blocks, const Parallel& parallel)
      : leaf_blocks_(leaf_blocks),
        leaves_(divide_up(size, leaf_blocks * kWidth)),
        points_(leaves_ * leaf_blocks * kWidth) {
    points_.fill(xyz, size);
    for (int64_t nodes = leaves_;; nodes = divide_up(nodes, kWidth)) {
      nodes_.push_back(nodes);
      levels_.emplace_back(static_cast<size_t>(divide_up(nodes, kWidth)));
      if (nodes <= kWidth) break;
    }
    arrange(parallel);
    bound_upper_levels();
  }

  int64_t leaves() const { return leaves_; }
  int leaf_blocks() const { return leaf_blocks_; }

  // Leaf i is blocks i * leaf_blocks() and following.
  Point16 points(int64_t block) const { return points_.points(block); }
  const int32_t* index(int64_t block) const { return &points_.index[block * kWidth]; }

  // Level 0 bounds the leaves; the last level is a single group. Child i of group g is node
  // 16 g + i of that level, whose own children are group 16 g + i of the level below.
  int top() const { return static_cast<int>(levels_.size()) - 1; }
  const Group& group(int level, int64_t g) const { return levels_[level][static_cast<size_t>(g)]; }
  int64_t groups(int level) const { return static_cast<int64_t>(levels_[level].size()); }

  // The places of a group that hold a node.
  Mask used(int level, int64_t g) const {
    const int64_t rest = nodes_[level] - g * kWidth;
    return rest >= kWidth ? 0xFFFFU : (1U << rest) - 1U;
  }

 private:
  struct Range {  // of leaves
    int64_t begin, end;
  };

  // Halves ranges until there are enough for all threads or each is a leaf, then builds each to its
  // leaves.
  void arrange(const Parallel& parallel) {
    PointArrays scratch(points_.blocks * kWidth);
    std::vector<Range> ranges = {{0, leaves_}};
    const int64_t wanted = parallel.threads > 1 && leaves_ >= 64 ? 2 * parallel.threads : 1;
    for (size_t i = 0; i < ranges.size(); ++i) {
      for (;;) {
        const int64_t leaves = ranges[i].end - ranges[i].begin;
        if (leaves == 1 || leaves * wanted <= leaves_) break;
        ranges.push_back(split(&ranges[i], scratch));
      }
    }
    parallel.run(static_cast<int64_t>(ranges.size()), leaves_ * 1000 / wanted,
                 [&](int64_t first, int64_t last) {
                   for (int64_t i = first; i < last; ++i) finish(ranges[i], scratch);
                 });
  }

  void finish(Range range, PointArrays& scratch) {
    while (range.end - range.begin > 1) finish(split(&range, scratch), scratch);
    levels_[0][static_cast<size_t>(range.begin / kWidth)].set(range.begin % kWidth, bounds(range));
  }

  Bounds bounds(const Range& range) const {
    return bounds_of(points_, range.begin * leaf_blocks_, range.end * leaf_blocks_);
  }

  // Cuts the range across its longest side, keeps the lower part and returns the upper one. Parts
  // above a group's size are cut at whole groups, so that groups are compact.
  Range split(Range* range, PointArrays& scratch) {
    const int64_t leaves = range->end - range->begin;
    int64_t unit = 1;
    while (unit * kWidth < leaves) unit *= kWidth;
    const int64_t lower = std::max<int64_t>(1, leaves / unit / 2) * unit;
    divide(points_, scratch, range->begin * leaf_blocks_, range->end * leaf_blocks_,
           lower * leaf_blocks_ * kWidth, bounds(*range));
    const Range upper = {range->begin + lower, range->end};
    range->end = upper.begin;
    return upper;
  }

  void bound_upper_levels() {
    for (size_t level = 1; level < levels_.size(); ++level) {
      for (int64_t node = 0; node < nodes_[level]; ++node) {
        const Group& below = levels_[level - 1][static_cast<size_t>(node)];
        Bounds bounds;
        for (int a = 0; a < 3; ++a) {
          bounds.low[a] = -largest(all(0.0F) - load(below.low[a]));
          bounds.high[a] = largest(load(below.high[a]));
        }
        levels_[level][static_cast<size_t>(node / kWidth)].set(node % kWidth, bounds);
      }
    }
  }

  int leaf_blocks_;
  int64_t leaves_;
  PointArrays points_;
  std::vector<int64_t> nodes_;  // per level
  std::vector<std::vector<Group>> levels_;
};

// One tree per cloud; a single cloud's tree is built by all threads together.
inline std::vector<std::unique_ptr<KdTree>> build_trees(const Clouds& clouds, int leaf_blocks,
                                                        const Parallel& parallel) {
  std::vector<std::unique_ptr<KdTree>> trees(static_cast<size_t>(clouds.batch));
  const auto build = [&](int64_t b, const Parallel& threads) {
    trees[b] = std::make_unique<KdTree>(clouds.xyz + 3 * b * clouds.size, clouds.size, leaf_blocks,
                                        threads);
  };
  if (clouds.batch == 1) {
    build(0, parallel);
  } else {
    parallel.run(clouds.batch, 30 * clouds.size, [&](int64_t begin, int64_t end) {
      for (int64_t b = begin; b < end; ++b) build(b, serial());
    });
  }
  return trees;
}

}  // namespace ptn::PTN_ISA
