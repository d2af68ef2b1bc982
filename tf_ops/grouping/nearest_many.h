// The k nearest points for large k: one query at a time. Whole blocks of candidates are buffered;
// a threshold that keeps about k of them is found by counting, and only those are put in order.
#pragma once

#include "core/isa.h"
#include "core/nodes.h"

namespace ptn::PTN_ISA {

constexpr int kManyLeafBlocks = 4;  // large leaves, since many points are needed

// Distance and index in one number, ordered by distance, then by index.
using Key = uint64_t;

// The bits of a float as an unsigned number of the same order; -0 and 0 are equal.
inline uint32_t ordered_bits(float value) {
  value += 0.0F;
  uint32_t raw;
  std::memcpy(&raw, &value, sizeof(raw));
  return (raw & 0x80000000U) != 0 ? ~raw : raw | 0x80000000U;
}
inline Key make_key(float value, int32_t index) {
  return static_cast<Key>(ordered_bits(value)) << 32 | static_cast<uint32_t>(index);
}

inline float value_of(Key key) {
  const uint32_t ordered = static_cast<uint32_t>(key >> 32);
  const uint32_t raw = (ordered & 0x80000000U) != 0 ? ordered & 0x7FFFFFFFU : ~ordered;
  float value;
  std::memcpy(&value, &raw, sizeof(value));
  return value;
}
inline int32_t index_of(Key key) { return static_cast<int32_t>(key & 0xFFFFFFFFU); }

class ManyNearest {
 public:
  explicit ManyNearest(int32_t k)
      : k_(k),
        enough_(int64_t{k} + k / 8 + kWidth),
        room_(divide_up(std::max<int64_t>(4 * int64_t{k}, 256), kWidth) * kWidth),
        distance_(room_ + kWidth),
        index_(room_ + kWidth),
        order_(room_) {}

  // Writes the k nearest points to the query; missing ones repeat the nearest.
  void find(const KdTree& tree, const float* query, float* dist2, int32_t* index) {
    size_ = 0;
    limit_ = kInfinity;
    query_ = all_point(query);
    visit(tree, tree.top(), 0);
    cut();
    if (size_ > kRankSort || !rank_sort(dist2, index)) sort_keys(dist2, index);
    std::fill(dist2 + std::min<int64_t>(size_, k_), dist2 + k_, dist2[0]);
    std::fill(index + std::min<int64_t>(size_, k_), index + k_, index[0]);
  }

 private:
  static constexpr int64_t kRankSort = 512;  // up to this size counting smaller values sorts faster

  void visit(const KdTree& tree, int level, int64_t g) {
    nearest_first(
        tree.group(level, g).distance2_to(query_), tree.used(level, g), [this] { return limit_; },
        [this, &tree, level, g](int lane) {
          const int64_t node = g * kWidth + lane;
          if (level > 0) return visit(tree, level - 1, node);
          const int64_t block = node * tree.leaf_blocks();
          for (int i = 0; i < tree.leaf_blocks(); ++i) scan(tree, block + i);
        });
  }

  void scan(const KdTree& tree, int64_t block) {
    const Point16 points = tree.points(block);
    const F16 d = distance2(points, query_);
    const Mask near = bits(both(d <= all(limit_), points.x < all(kInfinity)));
    compress(&distance_[size_], d, near);
    compress(&index_[size_], load(tree.index(block)), near);
    size_ += __builtin_popcount(near);
    if (size_ + kWidth > room_) cut();
  }

  // Keeps the k nearest of the buffer, and at most enough_ - k more.
  void cut() {
    if (size_ <= enough_) return;
    for (int64_t i = size_; i % kWidth != 0; ++i) distance_[i] = kInfinity;
    const int64_t blocks = divide_up(size_, kWidth);
    int64_t finite = 0;
    F16 most = all(0.0F);
    for (int64_t b = 0; b < blocks; ++b) {
      const F16 d = load(&distance_[b * kWidth]);
      finite += __builtin_popcount(bits(d < all(kInfinity)));
      most = max(most, select(d < all(kInfinity), d, all(0.0F)));
    }
    // Squared distances may overflow: with fewer than k finite ones all candidates stay, and
    // cut_ties chooses among those at infinity.
    if (finite >= k_) {
      limit_ =
          std::min(limit_, threshold(distance_.data(), blocks, k_, enough_, 0.0F, largest(most)));
    }
    int64_t kept = 0;
    for (int64_t b = 0; b < blocks; ++b) {
      const F16 d = load(&distance_[b * kWidth]);
      const I16 index = load(&index_[b * kWidth]);
      const Mask near = bits(d <= all(limit_)) & filled(b);
      compress(&distance_[kept], d, near);
      compress(&index_[kept], index, near);
      kept += __builtin_popcount(near);
    }
    size_ = kept;
    if (size_ > enough_) cut_ties();
  }

  Mask filled(int64_t block) const {
    const int64_t rest = size_ - block * kWidth;
    return rest >= kWidth ? 0xFFFFU : (1U << rest) - 1U;
  }

  std::vector<Key> keys() const {
    std::vector<Key> keys(static_cast<size_t>(size_));
    for (int64_t i = 0; i < size_; ++i) keys[i] = make_key(distance_[i], index_[i]);
    return keys;
  }

  // Keeps exactly the k nearest when too many are equally far.
  void cut_ties() {
    std::vector<Key> all_keys = keys();
    std::nth_element(all_keys.begin(), all_keys.begin() + k_ - 1, all_keys.end());
    const Key last = all_keys[k_ - 1];
    int64_t kept = 0;
    for (int64_t i = 0; i < size_; ++i) {
      if (make_key(distance_[i], index_[i]) > last) continue;
      distance_[kept] = distance_[i];
      index_[kept++] = index_[i];
    }
    size_ = kept;
  }

  // Puts each candidate at the rank that is the number of nearer ones; false if one of the first k
  // ties, since a tie leaves the next rank empty.
  bool rank_sort(float* dist2, int32_t* index) {
    for (int64_t i = size_; i % kWidth != 0; ++i) distance_[i] = kInfinity;
    std::fill_n(order_.data(), size_, -1);
    for (int64_t first = 0; first < size_; first += kWidth) {
      const F16 d = load(&distance_[first]);
      I16 nearer = all(0);
      for (int64_t i = 0; i < size_; ++i) nearer = count(nearer, all(distance_[i]) < d);
      alignas(64) int32_t rank[kWidth];
      store(rank, nearer);
      for (int64_t i = first; i < std::min(first + kWidth, size_); ++i) {
        order_[rank[i - first]] = static_cast<int32_t>(i);
      }
    }
    const int64_t wanted = std::min<int64_t>(size_, k_);
    if (wanted < size_ && order_[wanted] < 0) return false;
    for (int64_t i = 0; i < wanted; ++i) {
      const int32_t from = order_[i];
      if (from < 0) return false;
      dist2[i] = distance_[from];
      index[i] = index_[from];
    }
    return true;
  }

  void sort_keys(float* dist2, int32_t* index) {
    std::vector<Key> sorted = keys();
    std::sort(sorted.begin(), sorted.end());
    for (int64_t i = 0; i < std::min<int64_t>(size_, k_); ++i) {
      dist2[i] = value_of(sorted[i]);
      index[i] = index_of(sorted[i]);
    }
  }

  int32_t k_;
  int64_t enough_, room_, size_ = 0;
  AlignedArray<float> distance_;
  AlignedArray<int32_t> index_, order_;
  Point16 query_;
  float limit_ = kInfinity;
};

}  // namespace ptn::PTN_ISA
