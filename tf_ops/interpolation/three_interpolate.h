// Weighted sums of three rows and their gradient for the weights; independent of TensorFlow.
#pragma once

#include <cstdint>

#include "core/rows.h"

namespace ptn {

// out[b, e] = sum over k < 3 of weight[b, e, k] * points[b, index[b, e, k]], in float32.
template <class T>
void interpolate_rows(const T* points, const int32_t* index, const float* weight, RowSizes s,
                      T* out, const Parallel& parallel) {
  parallel.run(s.batch * s.entries, 10 + s.channels, [=](int64_t begin, int64_t end) {
    for (int64_t e = begin; e < end; ++e) {
      const T* cloud = points + e / s.entries * s.rows * s.channels;
      const T* __restrict row0 = cloud + index[3 * e] * s.channels;
      const T* __restrict row1 = cloud + index[3 * e + 1] * s.channels;
      const T* __restrict row2 = cloud + index[3 * e + 2] * s.channels;
      const float w0 = weight[3 * e], w1 = weight[3 * e + 1], w2 = weight[3 * e + 2];
      T* __restrict to = out + e * s.channels;
      for (int64_t c = 0; c < s.channels; ++c) {
        to[c] =
            static_cast<T>((w0 * static_cast<float>(row0[c]) + w1 * static_cast<float>(row1[c])) +
                           w2 * static_cast<float>(row2[c]));
      }
    }
  });
}

// Dot product in float32, sixteen partial sums.
template <class T>
float dot(const T* a, const T* b, int64_t channels) {
  float part[16] = {};
  int64_t c = 0;
  for (; c + 16 <= channels; c += 16) {
    for (int i = 0; i < 16; ++i) {
      part[i] += static_cast<float>(a[c + i]) * static_cast<float>(b[c + i]);
    }
  }
  for (; c < channels; ++c) part[c % 16] += static_cast<float>(a[c]) * static_cast<float>(b[c]);
  for (int step = 8; step > 0; step /= 2) {
    for (int i = 0; i < step; ++i) part[i] += part[i + step];
  }
  return part[0];
}

// grad_weight[b, e, k] = grad[b, e] . points[b, index[b, e, k]].
template <class T>
void interpolation_weight_grad(const T* points, const int32_t* index, const T* grad, RowSizes s,
                               float* grad_weight, const Parallel& parallel) {
  parallel.run(s.batch * s.entries, 10 + s.channels, [=](int64_t begin, int64_t end) {
    for (int64_t e = begin; e < end; ++e) {
      const T* cloud = points + e / s.entries * s.rows * s.channels;
      for (int k = 0; k < 3; ++k) {
        grad_weight[3 * e + k] =
            dot(grad + e * s.channels, cloud + index[3 * e + k] * s.channels, s.channels);
      }
    }
  });
}

}  // namespace ptn
