// Exact farthest point sampling over k-d buckets (after Han et al., "QuickFPS", TCAD 2023): a new
// sample updates only buckets with a point nearer to it than to all samples before.
#pragma once

#include "core/isa.h"
#include "core/kd_tree.h"

namespace ptn::PTN_ISA {

class FarthestPoints {
 public:
  FarthestPoints(const float* xyz, int64_t size, const Parallel& parallel)
      : xyz_(xyz), tree_(xyz, size, kLeafBlocks, parallel) {
    for (int level = 0; level <= tree_.top(); ++level) {
      best_.emplace_back(static_cast<size_t>(tree_.groups(level)));
    }
    distance_.resize(static_cast<size_t>(tree_.leaves() * kLeafBlocks));
    for (int64_t i = 0; i < tree_.leaves(); ++i) start_leaf(i);
    for (int level = 1; level <= tree_.top(); ++level) {
      for (int64_t g = 0; g < tree_.groups(level - 1); ++g) summarise(level - 1, g);
    }
  }

  // The first sample is point 0; each next one is the point farthest from all samples.
  void run(int32_t npoint, int32_t* index) {
    for (int32_t i = 0; i < npoint; ++i) {
      index[i] = i == 0 ? 0 : farthest(best_[tree_.top()][0]).index;
      add(index[i]);
    }
  }

 private:
  static constexpr int kLeafBlocks = 2;

  struct alignas(64) Distances {
    float to_sample[kWidth];
  };
  // Of each node of a group: its farthest point, its distance to the samples, lowest index first.
  struct alignas(64) Best {
    float distance[kWidth];
    int32_t index[kWidth];
    int32_t place[kWidth];  // within the leaf; level 0 only
    Best() {
      std::fill_n(distance, kWidth, 0.0F);
      std::fill_n(index, kWidth, kNoPoint);
      std::fill_n(place, kWidth, 0);
    }
  };
  struct Candidate {
    float distance;
    int32_t index;
  };

  static Candidate farthest(const Best& best) {
    const F16 distance = load(best.distance);
    const float most = largest(distance);
    int32_t index = kNoPoint;
    for_each_lane(bits(distance == all(most)),
                  [&](int i) { index = std::min(index, best.index[i]); });
    return {most, index};
  }

  void start_leaf(int64_t leaf) {
    for (int64_t b = leaf * kLeafBlocks; b < (leaf + 1) * kLeafBlocks; ++b) {
      for (int i = 0; i < kWidth; ++i) {
        distance_[b].to_sample[i] = tree_.index(b)[i] == kNoPoint ? 0.0F : kInfinity;
      }
    }
    find_farthest(leaf);
  }

  void add(int32_t sample) {
    visit(all_point(xyz_ + 3 * static_cast<int64_t>(sample)), tree_.top(), 0);
  }

  // Lowers the distances of all points below the group that are nearer to q.
  void visit(const Point16& q, int level, int64_t g) {
    const F16 bound = tree_.group(level, g).distance2_to(q);
    for_each_lane(bits(bound < load(best_[level][g].distance)), [&](int i) {
      const int64_t node = g * kWidth + i;
      if (level == 0) {
        update_leaf(q, node);
      } else {
        visit(q, level - 1, node);
        summarise(level - 1, node);
      }
    });
  }

  // Copies the best of a group to the group's node on the level above.
  void summarise(int level, int64_t g) {
    const Candidate c = farthest(best_[level][g]);
    Best& above = best_[level + 1][g / kWidth];
    above.distance[g % kWidth] = c.distance;
    above.index[g % kWidth] = c.index;
  }

  void update_leaf(const Point16& q, int64_t leaf) {
    const int64_t first = leaf * kLeafBlocks;
    Distances* d = &distance_[first];
    for (int b = 0; b < kLeafBlocks; ++b) {
      store(d[b].to_sample, min(load(d[b].to_sample), distance2(tree_.points(first + b), q)));
    }
    // Distances only decrease: the farthest point stays the farthest while its distance is the
    // same.
    const Best& best = best_[0][leaf / kWidth];
    const int place = best.place[leaf % kWidth];
    const float now = d[place / kWidth].to_sample[place % kWidth];
    if (now < best.distance[leaf % kWidth]) find_farthest(leaf);
  }

  void find_farthest(int64_t leaf) {
    const int64_t first = leaf * kLeafBlocks;
    const Distances* d = &distance_[first];
    F16 most = load(d[0].to_sample);
    for (int b = 1; b < kLeafBlocks; ++b) most = max(most, load(d[b].to_sample));
    const float distance = largest(most);
    int32_t index = kNoPoint;
    int place = 0;
    for (int b = 0; b < kLeafBlocks; ++b) {
      for_each_lane(bits(load(d[b].to_sample) == all(distance)), [&](int i) {
        if (tree_.index(first + b)[i] < index) {
          index = tree_.index(first + b)[i];
          place = b * kWidth + i;
        }
      });
    }
    Best& best = best_[0][leaf / kWidth];
    best.distance[leaf % kWidth] = distance;
    best.index[leaf % kWidth] = index;
    best.place[leaf % kWidth] = place;
  }

  const float* xyz_;
  KdTree tree_;
  std::vector<Distances> distance_;      // per block
  std::vector<std::vector<Best>> best_;  // per level and group
};

inline void farthest_point_sample(Clouds clouds, int32_t npoint, int32_t* index,
                                  const Parallel& parallel) {
  const auto sample = [&](int64_t b, const Parallel& threads) {
    FarthestPoints points(clouds.xyz + 3 * b * clouds.size, clouds.size, threads);
    points.run(npoint, index + b * npoint);
  };
  if (clouds.batch == 1) return sample(0, parallel);
  parallel.run(clouds.batch, 100 * clouds.size + 500 * int64_t{npoint},
               [&](int64_t begin, int64_t end) {
                 for (int64_t b = begin; b < end; ++b) sample(b, serial());
               });
}

}  // namespace ptn::PTN_ISA
