// The k nearest points of a k-d tree, ties to the lower index, and the k smallest of a row.
//
// To be included inside the namespace of one instruction set.

// Distance and index in one number: ordered by distance, then by index. Distances are >= 0, so
// their bits are ordered as they are.
using Key = uint64_t;
constexpr Key kNoKey = std::numeric_limits<Key>::max();

inline Key make_key(uint32_t ordered, int32_t index) {
  return static_cast<Key>(ordered) << 32 | static_cast<uint32_t>(index);
}
inline Key make_key(float distance2, int32_t index) {
  uint32_t ordered;
  std::memcpy(&ordered, &distance2, sizeof(ordered));
  return make_key(ordered, index);
}
inline float distance_of(Key key) {
  const uint32_t ordered = static_cast<uint32_t>(key >> 32);
  float distance2;
  std::memcpy(&distance2, &ordered, sizeof(distance2));
  return distance2;
}
inline int32_t index_of(Key key) { return static_cast<int32_t>(key & 0xFFFFFFFFU); }

constexpr Key kFarthest = Key{0x7F800000U} << 32 | uint32_t(kNoPoint);  // infinity, no point

// The k smallest keys, always in order: for small k.
class SortedKeys {
 public:
  explicit SortedKeys(int32_t k) : keys_(static_cast<size_t>(k)) {}
  void clear() { std::fill(keys_.begin(), keys_.end(), kFarthest); }
  Key worst() const { return keys_.back(); }
  void add(Key key) {
    if (key >= keys_.back()) return;
    size_t i = keys_.size() - 1;
    for (; i > 0 && keys_[i - 1] > key; --i) keys_[i] = keys_[i - 1];
    keys_[i] = key;
  }
  const Key* finish() { return keys_.data(); }

 private:
  std::vector<Key> keys_;
};

// The k smallest keys, gathered in a buffer that is cut to k when full: for large k.
class BufferedKeys {
 public:
  explicit BufferedKeys(int32_t k) : k_(static_cast<size_t>(k)), keys_(2 * k_ + 64) {}
  void clear() {
    size_ = 0;
    worst_ = kFarthest;
  }
  Key worst() const { return worst_; }
  void add(Key key) {
    if (key >= worst_) return;
    keys_[size_++] = key;
    if (size_ == keys_.size()) cut();
  }
  const Key* finish() {
    if (size_ > k_) cut();
    std::sort(keys_.begin(), keys_.begin() + static_cast<int64_t>(size_));
    std::fill(keys_.begin() + static_cast<int64_t>(size_),
              keys_.begin() + static_cast<int64_t>(std::max(k_, size_)), kFarthest);
    return keys_.data();
  }

 private:
  void cut() {
    const auto last = keys_.begin() + static_cast<int64_t>(k_) - 1;
    std::nth_element(keys_.begin(), last, keys_.begin() + static_cast<int64_t>(size_));
    worst_ = *last;
    size_ = k_;
  }

  size_t k_, size_ = 0;
  std::vector<Key> keys_;
  Key worst_ = kFarthest;
};

// Adds to `keys` all points under the group that may be among the nearest, nearest nodes first.
template <class Keys>
void gather_nearest(const KdTree& tree, const Query& q, int level, int64_t g, Keys& keys) {
  alignas(64) float bound[kWidth];
  const F16 bounds = tree.group(level, g).distance2(q);
  store(bound, bounds);
  Key order[kWidth];
  int nodes = 0;
  for_each_lane((bounds <= all(distance_of(keys.worst()))) & tree.used(level, g), [&](int i) {
    const Key key = make_key(bound[i], i);
    int j = nodes++;
    for (; j > 0 && order[j - 1] > key; --j) order[j] = order[j - 1];
    order[j] = key;
  });
  for (int n = 0; n < nodes && distance_of(order[n]) <= distance_of(keys.worst()); ++n) {
    const int64_t node = g * kWidth + index_of(order[n]);
    if (level > 0) {
      gather_nearest(tree, q, level - 1, node, keys);
      continue;
    }
    for (int b = 0; b < tree.leaf_blocks(); ++b) {
      const Block& block = tree.leaf(node)[b];
      const F16 d = block.distance2(q);
      alignas(64) float distance2[kWidth];
      store(distance2, d);
      for_each_lane(d <= all(distance_of(keys.worst())),
                    [&](int i) { keys.add(make_key(distance2[i], block.index[i])); });
    }
  }
}

// Index of the nearest point.
inline int32_t nearest_point(const KdTree& tree, const float* query) {
  SortedKeys keys(1);
  keys.clear();
  gather_nearest(tree, Query(query), tree.top(), 0, keys);
  return index_of(keys.worst());
}
