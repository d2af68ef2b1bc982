// The box ops over a batch of scenes, shared among threads. Knows nothing of TensorFlow.
#pragma once

#include <algorithm>
#include <cstdint>

#include "boxes/rotated.h"
#include "core/parallel.h"

namespace ptn {

using PairIou = double (*)(const RotatedBox&, const RotatedBox&);

// iou (batch, rows, columns) of boxes (batch, rows) with others (batch, columns).
inline void all_ious(PairIou pair, const RotatedBox* boxes, const RotatedBox* others, int64_t batch,
                     int64_t rows, int64_t columns, float* iou, const Parallel& parallel) {
  parallel.run(batch * rows, 20 * columns, [=](int64_t begin, int64_t end) {
    for (int64_t row = begin; row < end; ++row) {
      const RotatedBox* scene = others + row / rows * columns;
      for (int64_t i = 0; i < columns; ++i) {
        iou[row * columns + i] = static_cast<float>(pair(boxes[row], scene[i]));
      }
    }
  });
}

// index (batch, points): the first of the boxes (batch, count) that holds the point, or -1.
inline void first_holders(const float* xyz, const RotatedBox* boxes, int64_t batch, int64_t points,
                          int64_t count, int32_t* index, const Parallel& parallel) {
  parallel.run(batch * points, 3 * count, [=](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      const RotatedBox* first = boxes + i / points * count;
      const RotatedBox* last = first + count;
      const auto holds = [=](const RotatedBox& box) { return box.holds(xyz + 3 * i); };
      const RotatedBox* holder = std::find_if(first, last, holds);
      index[i] = holder == last ? -1 : static_cast<int32_t>(holder - first);
    }
  });
}

}  // namespace ptn
