// A balanced k-d tree, sixteen children wide: blocks of sixteen points at the bottom, groups of
// sixteen bounding boxes above. One comparison of a whole group decides which children matter.
//
// Bounds are exact in float32. A point's squared distance and the distance to a box that holds it
// are computed with the same operations; rounding is monotonic, so the box's is never the larger.
// Pruning therefore changes no result, not even among ties.
//
// To be included inside the namespace of one instruction set, after simd.h.

constexpr int kWidth = 16;
constexpr int32_t kNoPoint = std::numeric_limits<int32_t>::max();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Sixteen points; unused places lie at infinity and have index kNoPoint.
struct alignas(64) Block {
  float x[kWidth], y[kWidth], z[kWidth];
  int32_t index[kWidth];

  F16 distance2(const Query& q) const {
    return squared(load(x) - q.x, load(y) - q.y, load(z) - q.z);
  }
};

// Sixteen bounding boxes; unused places are empty boxes, infinitely far from anything.
struct alignas(64) Group {
  float low[3][kWidth], high[3][kWidth];

  // Squared distance from q to each box, 0 inside: a lower bound for the points in it.
  F16 distance2(const Query& q) const {
    return squared(gap(q.x, 0), gap(q.y, 1), gap(q.z, 2));
  }

 private:
  F16 gap(F16 q, int axis) const {
    return max(max(load(low[axis]) - q, q - load(high[axis])), all(0.0F));
  }
};

class KdTree {
 public:
  // Builds over `size` >= 1 points, `leaf_blocks` blocks to a leaf.
  KdTree(const float* xyz, int64_t size, int leaf_blocks, const Parallel& parallel)
      : leaf_blocks_(leaf_blocks), leaf_size_(leaf_blocks * kWidth) {
    leaves_ = (size + leaf_size_ - 1) / leaf_size_;
    std::vector<Point> points(static_cast<size_t>(size));
    for (int64_t i = 0; i < size; ++i) {
      points[i] = {{xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]}, static_cast<int32_t>(i)};
    }
    make_levels();
    blocks_.resize(static_cast<size_t>(leaves_ * leaf_blocks_));
    arrange(points.data(), size, parallel);
    bound_upper_levels();
  }

  int64_t leaves() const { return leaves_; }
  int leaf_blocks() const { return leaf_blocks_; }
  const Block* leaf(int64_t i) const { return &blocks_[static_cast<size_t>(i * leaf_blocks_)]; }

  // Level 0 bounds the leaves; the last level is a single group. Child i of group g is node
  // 16 g + i of that level, whose own children are group 16 g + i of the level below.
  int top() const { return static_cast<int>(levels_.size()) - 1; }
  const Group& group(int level, int64_t g) const { return levels_[level][static_cast<size_t>(g)]; }
  int64_t groups(int level) const { return static_cast<int64_t>(levels_[level].size()); }

  // Which places of a group hold a node.
  Mask used(int level, int64_t g) const {
    const int64_t rest = nodes_[level] - g * kWidth;
    return rest >= kWidth ? 0xFFFFU : (1U << rest) - 1U;
  }

 private:
  struct alignas(16) Point {
    float at[3];
    int32_t index;
  };
  struct Range {  // points [begin, end) make the leaves from `leaf` on
    int64_t begin, end, leaf;
  };
  struct Bounds {
    float low[3] = {kInfinity, kInfinity, kInfinity};
    float high[3] = {-kInfinity, -kInfinity, -kInfinity};

    void add(const float* point) {
      for (int a = 0; a < 3; ++a) {
        low[a] = std::min(low[a], point[a]);
        high[a] = std::max(high[a], point[a]);
      }
    }
    int longest() const {
      const float e[3] = {high[0] - low[0], high[1] - low[1], high[2] - low[2]};
      return e[0] >= e[1] ? (e[0] >= e[2] ? 0 : 2) : (e[1] >= e[2] ? 1 : 2);
    }
  };

  void make_levels() {
    Group empty;
    for (int a = 0; a < 3; ++a) {
      std::fill_n(empty.low[a], kWidth, kInfinity);
      std::fill_n(empty.high[a], kWidth, -kInfinity);
    }
    for (int64_t nodes = leaves_;; nodes = (nodes + kWidth - 1) / kWidth) {
      nodes_.push_back(nodes);
      levels_.emplace_back(static_cast<size_t>((nodes + kWidth - 1) / kWidth), empty);
      if (nodes <= kWidth) return;
    }
  }

  // Halves ranges until there are enough for all threads, then finishes each one.
  void arrange(Point* points, int64_t size, const Parallel& parallel) {
    std::vector<Range> ranges = {{0, size, 0}};
    const size_t wanted = size < 4096 || parallel.threads < 2 ? 1 : 4 * size_t(parallel.threads);
    for (size_t i = 0; i < ranges.size() && ranges.size() < wanted; ++i) {
      while (ranges[i].end - ranges[i].begin > size / static_cast<int64_t>(wanted / 2) &&
             leaves_of(ranges[i]) > 1) {
        ranges.push_back(split(points, &ranges[i]));
      }
    }
    const auto finish = [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) arrange_range(points, ranges[i]);
    };
    if (ranges.size() == 1) return finish(0, 1);
    parallel.run(static_cast<int64_t>(ranges.size()), 50 * size, finish);
  }

  void arrange_range(Point* points, Range range) {
    while (leaves_of(range) > 1) arrange_range(points, split(points, &range));
    fill_leaf(points, range);
  }

  int64_t leaves_of(const Range& r) const {
    return (r.end - r.begin + leaf_size_ - 1) / leaf_size_;
  }

  // Cuts the range across its longest side, keeps the lower part and returns the upper one. The
  // lower part is whole leaves, as many as make whole groups, so that groups are compact.
  Range split(Point* points, Range* range) const {
    const int64_t leaves = leaves_of(*range);
    int64_t unit = 1;
    while (unit * kWidth < leaves) unit *= kWidth;
    const int64_t lower = std::max<int64_t>(1, leaves / unit / 2) * unit;
    Bounds bounds;
    for (int64_t i = range->begin; i < range->end; ++i) bounds.add(points[i].at);
    const int64_t middle = range->begin + lower * leaf_size_;
    const int axis = bounds.longest();
    std::nth_element(points + range->begin, points + middle, points + range->end,
                     [axis](const Point& a, const Point& b) { return a.at[axis] < b.at[axis]; });
    const Range upper = {middle, range->end, range->leaf + lower};
    range->end = middle;
    return upper;
  }

  void fill_leaf(const Point* points, const Range& range) {
    Block* blocks = &blocks_[static_cast<size_t>(range.leaf * leaf_blocks_)];
    Bounds bounds;
    for (int i = 0; i < leaf_size_; ++i) {
      Block& block = blocks[i / kWidth];
      const int lane = i % kWidth;
      if (range.begin + i < range.end) {
        const Point& p = points[range.begin + i];
        bounds.add(p.at);
        block.x[lane] = p.at[0];
        block.y[lane] = p.at[1];
        block.z[lane] = p.at[2];
        block.index[lane] = p.index;
      } else {
        block.x[lane] = block.y[lane] = block.z[lane] = kInfinity;
        block.index[lane] = kNoPoint;
      }
    }
    Group& group = levels_[0][static_cast<size_t>(range.leaf / kWidth)];
    for (int a = 0; a < 3; ++a) {
      group.low[a][range.leaf % kWidth] = bounds.low[a];
      group.high[a][range.leaf % kWidth] = bounds.high[a];
    }
  }

  void bound_upper_levels() {
    for (size_t level = 1; level < levels_.size(); ++level) {
      for (int64_t node = 0; node < nodes_[level]; ++node) {
        const Group& below = levels_[level - 1][static_cast<size_t>(node)];
        Group& group = levels_[level][static_cast<size_t>(node / kWidth)];
        for (int a = 0; a < 3; ++a) {
          group.low[a][node % kWidth] = *std::min_element(below.low[a], below.low[a] + kWidth);
          group.high[a][node % kWidth] = *std::max_element(below.high[a], below.high[a] + kWidth);
        }
      }
    }
  }

  int leaf_blocks_, leaf_size_;
  int64_t leaves_;
  std::vector<Block> blocks_;
  std::vector<int64_t> nodes_;               // per level
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
    parallel.run(clouds.batch, 100 * clouds.size, [&](int64_t begin, int64_t end) {
      for (int64_t b = begin; b < end; ++b) build(b, serial());
    });
  }
  return trees;
}
