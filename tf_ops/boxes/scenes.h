// IoU of all pairs of boxes over a batch of scenes, divided among threads; independent of
// TensorFlow.
#pragma once

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

}  // namespace ptn
