// Overlap and suppression of rotated boxes.

#include <algorithm>
#include <cmath>

#include "boxes/suppress_boxes.h"
#include "sanitize/stress.h"

namespace stress {
namespace {

constexpr int64_t kScenes = 2, kBoxes = 40;

// Boxes that are crowded, and slivers and copies among them, where rounding is at its worst.
std::vector<ptn::RotatedBox> crowded(std::mt19937* random) {
  std::uniform_real_distribution<float> uniform(0, 4);
  std::vector<float> values(kScenes * kBoxes * ptn::kBoxSize);
  for (float& v : values) v = uniform(*random);
  for (int64_t i = 0; i < kScenes * kBoxes; ++i) {
    float* box = values.data() + i * ptn::kBoxSize;
    if (i % 4 == 1) box[3 + i % 3] *= 1e-7F;
    if (i % 4 == 2) std::copy_n(box - ptn::kBoxSize, 6, box);
    if (i % 4 == 3) box[6] = static_cast<float>(i) * 1.57079633F;
  }
  return ptn::read_boxes(values.data(), kScenes * kBoxes);
}

void overlaps(const std::vector<ptn::RotatedBox>& all) {
  std::vector<float> iou(kScenes * kBoxes * kBoxes);
  std::vector<float> mutual(iou.size());
  ptn::all_ious(all.data(), all.data(), kScenes, kBoxes, kBoxes, iou.data(), real_threads(3));
  ptn::mutual_ious(all.data(), kScenes, kBoxes, mutual.data(), real_threads(3));
  for (int64_t i = 0; i < kScenes * kBoxes; ++i) {
    const ptn::RotatedBox* scene = all.data() + i / kBoxes * kBoxes;
    const float* row = iou.data() + i * kBoxes;
    for (int64_t j = 0; j < kBoxes; ++j) {
      const float mirrored = iou[(i / kBoxes * kBoxes + j) * kBoxes + i % kBoxes];
      expect(row[j] >= 0 && row[j] <= 1 && std::abs(row[j] - mirrored) < 1e-5F, "boxes", "iou", j);
      expect(std::abs(row[j] - mutual[i * kBoxes + j]) < 1e-5F, "boxes", "mutual iou", j);
      const double alone = std::max(0.0, ptn::iou_3d(all[i], scene[j]));  // near or not
      expect(std::abs(row[j] - alone) < 1e-6, "boxes", "iou of two boxes", j);
    }
  }
}

// Whether each box is kept, or taken by the first kept one that overlaps it enough.
void suppression(const std::vector<ptn::RotatedBox>& all) {
  constexpr float kLimit = 0.1F;
  const std::vector<float> weight(all.size(), 0.5F);
  const auto support = ptn::supports(all, weight.data(), 0.3F);
  const ptn::Suppressed found = ptn::suppress(all, support, kLimit, 20);
  expect(found.kept.size() == 20 && found.iou.size() == 20 * all.size(), "boxes", "kept", 20);
  for (size_t i = 0; i < all.size(); ++i) {
    int32_t first = 0;
    while (first < 20 && found.kept[first] != static_cast<int32_t>(i) &&
           found.iou[first * all.size() + i] <= kLimit) {
      ++first;
    }
    expect(found.owner[i] == (first < 20 ? first : -1), "boxes", "owner", first);
  }
}

}  // namespace

void boxes(uint32_t seed) {
  std::mt19937 random(seed);
  const auto all = crowded(&random);
  overlaps(all);
  suppression(all);
}

}  // namespace stress
