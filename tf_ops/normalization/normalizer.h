// Per-channel arithmetic between the passes of batch_norm.h; independent of TensorFlow.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "core/kernels.h"

namespace ptn {

// y = scale * (x - mean) + beta, per channel. Keeps the pointers beta and mean.
struct Normalizer {
  const float *mean, *beta;
  std::vector<float> scale, inverse;  // inverse = 1 / sqrt(variance + epsilon)

  Normalizer(const float* gamma, const float* beta_of, const float* mean_of, const float* variance,
             int64_t channels, float epsilon)
      : mean(mean_of), beta(beta_of) {
    for (int64_t c = 0; c < channels; ++c) {
      inverse.push_back(1.0F / std::sqrt(variance[c] + epsilon));
      scale.push_back(gamma[c] * inverse.back());
    }
  }
  Affine affine() const { return {mean, scale.data(), beta}; }
};

// From sums of the gradient g and of g * (x - mean): gradients of gamma and beta, and the part
// slope * (x - mean) + offset of the gradient of x that comes through the moments.
struct MomentGradient {
  const float* mean;
  std::vector<float> slope, offset;

  MomentGradient(const double* total, const Normalizer& n, int64_t rows, int64_t channels,
                 float* grad_gamma, float* grad_beta)
      : mean(n.mean) {
    for (int64_t c = 0; c < channels; ++c) {
      const auto i = static_cast<size_t>(c);
      const double inverse = static_cast<double>(n.inverse[i]);
      const double along = total[channels + c] * inverse;
      grad_beta[c] = static_cast<float>(total[c]);
      grad_gamma[c] = static_cast<float>(along);
      const double factor = static_cast<double>(n.scale[i]) / static_cast<double>(rows);
      slope.push_back(static_cast<float>(-factor * inverse * along));
      offset.push_back(static_cast<float>(-factor * total[c]));
    }
  }
  GradAffine affine() const { return {mean, slope.data(), offset.data()}; }
};

// 1 where the largest value of a channel gives the largest result, -1 where the smallest does.
inline std::vector<float> signs(const float* gamma, int64_t channels) {
  std::vector<float> sign;
  for (int64_t c = 0; c < channels; ++c) sign.push_back(gamma[c] < 0 ? -1.0F : 1.0F);
  return sign;
}

// The gradient through the ReLU at each group's place: times scale into spike (groups, channels),
// and its sums, alone and times (x - mean), into total (2 channels).
inline void gather_spikes(const float* grad, const float* x, const int32_t* place,
                          const Normalizer& n, int64_t groups, int64_t size, int64_t channels,
                          float* spike, double* total) {
  for (int64_t c = 0; c < 2 * channels; ++c) total[c] = 0.0;
  for (int64_t g = 0; g < groups; ++g) {
    for (int64_t c = 0; c < channels; ++c) {
      const int64_t i = g * channels + c;
      const float d = x[(g * size + place[i]) * channels + c] - n.mean[c];
      const float scale = n.scale[static_cast<size_t>(c)];
      const float through = d * scale + n.beta[c] > 0.0F ? grad[i] : 0.0F;
      spike[i] = scale * through;
      total[c] += static_cast<double>(through);
      total[channels + c] += static_cast<double>(through * d);
    }
  }
}

}  // namespace ptn
