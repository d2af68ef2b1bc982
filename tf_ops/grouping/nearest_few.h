// The k nearest points for small k: sixteen neighbouring queries at a time, a lane each. Each lane
// keeps a sorted list; a candidate is offered to all lanes at once.
#pragma once

#include "core/isa.h"
#include "core/nodes.h"

namespace ptn::PTN_ISA {

constexpr int32_t kFew = 16;  // the largest k for which this is faster than nearest_many.h

// Per lane the kSize nearest candidates, in order of distance, then of index.
template <int kSize>
struct NearestLists {
  F16 distance[kSize];
  I16 index[kSize];

  // Lanes outside `used` start with distance 0 and accept no candidate.
  explicit NearestLists(M16 used) {
    for (int i = 0; i < kSize; ++i) {
      distance[i] = select(used, all(kInfinity), all(0.0F));
      index[i] = all(kNoPoint);
    }
  }

  F16 worst() const { return distance[kSize - 1]; }

  void offer(F16 d, int32_t candidate) {
    I16 id = all(candidate);
    for (int i = 0; i < kSize; ++i) {
      const M16 nearer = either(d < distance[i], both(d == distance[i], id < index[i]));
      const F16 old_distance = distance[i];
      const I16 old_index = index[i];
      distance[i] = select(nearer, d, old_distance);
      index[i] = select(nearer, id, old_index);
      d = select(nearer, old_distance, d);
      id = select(nearer, old_index, id);
    }
  }
};

template <int kSize>
class FewNearest {
 public:
  // The nearest points of `tree` for the block of queries.
  FewNearest(const KdTree& tree, const KdTree& queries, int64_t block)
      : tree_(tree), query_(queries.points(block)), lists_(query_.x < all(kInfinity)) {
    const Group& group = queries.group(0, block / kWidth);
    float from[3], to[3];
    for (int a = 0; a < 3; ++a) {
      from[a] = group.low[a][block % kWidth];
      to[a] = group.high[a][block % kWidth];
    }
    from_ = all_point(from);
    to_ = all_point(to);
    limit_ = largest(lists_.worst());
    visit(tree.top(), 0);
  }

  const NearestLists<kSize>& lists() const { return lists_; }

 private:
  void visit(int level, int64_t g) {
    nearest_first(
        tree_.group(level, g).distance2_to(from_, to_), tree_.used(level, g),
        [this] { return limit_; },
        [this, level, g](int lane) {
          const int64_t node = g * kWidth + lane;
          level > 0 ? visit(level - 1, node) : scan(node);
        });
  }

  // Offers the sixteen points of a leaf.
  void scan(int64_t leaf) {
    alignas(64) float at[3][kWidth];
    const Point16 points = tree_.points(leaf);
    store(at[0], points.x);
    store(at[1], points.y);
    store(at[2], points.z);
    for (int i = 0; i < kWidth; ++i) {
      const F16 d = distance2({all(at[0][i]), all(at[1][i]), all(at[2][i])}, query_);
      if (bits(d <= lists_.worst()) != 0) lists_.offer(d, tree_.index(leaf)[i]);
    }
    limit_ = largest(lists_.worst());
  }

  const KdTree& tree_;
  Point16 query_, from_, to_;
  NearestLists<kSize> lists_;
  float limit_;
};

// Writes the k <= kSize nearest of each query; missing ones repeat the nearest.
template <int kSize>
void few_nearest(const KdTree& tree, const KdTree& queries, int32_t k, float* dist2, int32_t* index,
                 int64_t begin, int64_t end) {
  for (int64_t block = begin; block < end; ++block) {
    const FewNearest<kSize> nearest(tree, queries, block);
    alignas(64) float distances[kSize][kWidth];
    alignas(64) int32_t indices[kSize][kWidth];
    for (int i = 0; i < kSize; ++i) {
      store(distances[i], nearest.lists().distance[i]);
      store(indices[i], nearest.lists().index[i]);
    }
    for (int lane = 0; lane < kWidth && queries.index(block)[lane] != kNoPoint; ++lane) {
      const int64_t row = queries.index(block)[lane];
      for (int32_t i = 0; i < k; ++i) {
        const int from = indices[i][lane] == kNoPoint ? 0 : i;
        dist2[row * k + i] = distances[from][lane];
        index[row * k + i] = indices[from][lane];
      }
    }
  }
}

// Index of the point nearest to one query, the lowest among ties.
class Nearest {
 public:
  static int32_t find(const KdTree& tree, const float* query) {
    Nearest nearest(tree, query);
    nearest.visit(tree.top(), 0);
    return nearest.index_;
  }

 private:
  Nearest(const KdTree& tree, const float* query) : tree_(tree), query_(all_point(query)) {}

  void visit(int level, int64_t g) {
    nearest_first(
        tree_.group(level, g).distance2_to(query_), tree_.used(level, g),
        [this] { return distance_; },
        [this, level, g](int lane) {
          const int64_t node = g * kWidth + lane;
          level > 0 ? visit(level - 1, node) : scan(node);
        });
  }

  void scan(int64_t leaf) {
    alignas(64) float found[kWidth];
    const F16 d = distance2(tree_.points(leaf), query_);
    store(found, d);
    for_each_lane(bits(d <= all(distance_)), [&](int lane) {
      const int32_t index = tree_.index(leaf)[lane];
      if (found[lane] > distance_ || (found[lane] == distance_ && index > index_)) return;
      distance_ = found[lane];
      index_ = index;
    });
  }

  const KdTree& tree_;
  Point16 query_;
  float distance_ = kInfinity;
  int32_t index_ = kNoPoint;
};

}  // namespace ptn::PTN_ISA
