// Greedy non-maximum suppression of boxes by their support, independent of TensorFlow.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "boxes/box_iou_3d.h"

namespace ptn {

// The sum of IoU times weight over the boxes that overlap each by at least `least`, in their order.
inline std::vector<double> supports(const std::vector<RotatedBox>& boxes, const float* weight,
                                    float least) {
  std::vector<double> support(boxes.size());
  Row near;
  for (size_t row = 0; row < boxes.size(); ++row) {
    double* sum = support.data() + row;
    const float* from = weight + row;
    const auto vote = [=](int64_t i, float iou) {
      if (iou < least) return;
      sum[0] += static_cast<double>(iou) * static_cast<double>(from[i]);
      if (i > 0) sum[i] += static_cast<double>(iou) * static_cast<double>(from[0]);
    };
    near.find(boxes[row], &boxes[row], static_cast<int64_t>(boxes.size() - row), vote);
  }
  return support;
}

struct Suppressed {
  std::vector<int32_t> kept;   // rows of the kept boxes, most supported first
  std::vector<int32_t> owner;  // per box: the kept one (counted from 0) that takes it, or -1
  std::vector<float> iou;      // (kept, boxes)
};

// The best supported box left, ties to the lower row, takes those left that it overlaps by more
// than `limit`; so on until none is left or `most` are kept.
inline Suppressed suppress(const std::vector<RotatedBox>& boxes, const std::vector<double>& support,
                           float limit, int32_t most) {
  std::vector<int32_t> order(boxes.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int32_t a, int32_t b) { return support[a] > support[b]; });
  Suppressed found;
  found.owner.assign(boxes.size(), -1);
  Row near;
  for (const int32_t best : order) {
    const auto place = static_cast<int32_t>(found.kept.size());
    if (place == most) break;
    if (found.owner[best] >= 0) continue;
    found.kept.push_back(best);
    found.iou.resize(found.kept.size() * boxes.size());
    float* row = found.iou.data() + place * boxes.size();
    int32_t* owner = found.owner.data();
    const auto take = [=](int64_t i, float iou) {
      row[i] = iou;
      if (owner[i] < 0 && iou > limit) owner[i] = place;
    };
    near.find(boxes[best], boxes.data(), static_cast<int64_t>(boxes.size()), take);
    owner[best] = place;  // also if it is empty
  }
  return found;
}

}  // namespace ptn
