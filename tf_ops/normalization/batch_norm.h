// Batch normalisation with ReLU, and with ReLU and maximum over neighbours, forward and backward,
// over rows of `channels` values. Sums are taken over blocks of rows in float32 and joined in order
// in float64, so the result is the same for any number of threads.
#pragma once

#include "core/isa.h"

namespace ptn::PTN_ISA {

constexpr int64_t kBlock = 256;  // rows

inline void add_row_to(const float* __restrict row, int64_t channels, float* __restrict sum) {
  for (int64_t c = 0; c < channels; ++c) sum[c] += row[c];
}

inline void add_deviations(const float* __restrict row, const float* __restrict center,
                           int64_t channels, float* __restrict first, float* __restrict second) {
  for (int64_t c = 0; c < channels; ++c) {
    const float d = row[c] - center[c];
    first[c] += d;
    second[c] += d * d;
  }
}

// Joins the moments of one more block of `count` rows to those of the `before` rows before it
// (Chan, Golub and LeVeque, 1983). block: its center, and sums of x - center and of the square.
inline void join_moments(const float* block, int64_t channels, int64_t before, int64_t count,
                         double* mean, double* squares) {
  const double n = static_cast<double>(count), all = static_cast<double>(before + count);
  for (int64_t c = 0; c < channels; ++c) {
    const double first = static_cast<double>(block[channels + c]);
    const double here = static_cast<double>(block[c]) + first / n, gap = here - mean[c];
    const double second = static_cast<double>(block[2 * channels + c]) - first * first / n;
    squares[c] += second + gap * gap * static_cast<double>(before) * n / all;
    mean[c] += gap * n / all;
  }
}

// Mean and (biased) variance of x (rows, channels), rows >= 1. Work is divided into parts of `size`
// rows, and these into blocks of at most kBlock. In each block the rows are summed, then their
// deviations from the block's own mean: neither a mean that is large against the deviation nor an
// outlier costs precision. If `size` exceeds kBlock, it must divide `rows`.
// sum(begin, end, total) adds the rows [begin, end) to total (channels), a part's in order.
template <class Sum>
void moments(const float* x, int64_t rows, int64_t size, int64_t channels, float* mean,
             float* variance, const Parallel& parallel, const Sum& sum) {
  const int64_t parts = (rows + size - 1) / size, width = 3 * channels;
  const int64_t per_part = (size + kBlock - 1) / kBlock, blocks = parts * per_part;
  const auto begin_of = [=](int64_t b) { return b / per_part * size + b % per_part * kBlock; };
  const auto end_of = [=](int64_t b) {
    return std::min(std::min(rows, (b / per_part + 1) * size), begin_of(b) + kBlock);
  };
  std::vector<float> partial(static_cast<size_t>(blocks * width), 0.0F);
  parallel.run(parts, size * (1 + channels / 2), [&](int64_t first, int64_t last) {
    for (int64_t b = first * per_part; b < last * per_part; ++b) {
      const int64_t begin = begin_of(b), end = end_of(b);
      float* center = partial.data() + b * width;
      sum(begin, end, center);
      for (int64_t c = 0; c < channels; ++c) center[c] /= static_cast<float>(end - begin);
      for (int64_t r = begin; r < end; ++r) {
        add_deviations(x + r * channels, center, channels, center + channels,
                       center + 2 * channels);
      }
    }
  });
  std::vector<double> total(static_cast<size_t>(2 * channels), 0.0);
  double *mean_so_far = total.data(), *squares = total.data() + channels;
  for (int64_t b = 0; b < blocks; ++b) {
    const int64_t begin = begin_of(b);
    join_moments(partial.data() + b * width, channels, begin, end_of(b) - begin, mean_so_far,
                 squares);
  }
  for (int64_t c = 0; c < channels; ++c) {
    mean[c] = static_cast<float>(mean_so_far[c]);
    variance[c] = static_cast<float>(std::max(squares[c] / static_cast<double>(rows), 0.0));
  }
}

// mean, variance (channels) of x (rows, channels); rows >= 1.
inline void column_moments(const float* x, int64_t rows, int64_t channels, float* mean,
                           float* variance, const Parallel& parallel) {
  moments(x, rows, kBlock, channels, mean, variance, parallel,
          [=](int64_t begin, int64_t end, float* total) {
            for (int64_t r = begin; r < end; ++r) add_row_to(x + r * channels, channels, total);
          });
}

inline void affine_relu_row(const float* x, const float* __restrict mean,
                            const float* __restrict scale, const float* __restrict shift,
                            int64_t channels, float* y) {
  for (int64_t c = 0; c < channels; ++c) {
    const float value = (x[c] - mean[c]) * scale[c] + shift[c];
    y[c] = 0.0F > value ? 0.0F : value;  // NaN stays NaN
  }
}

// y = relu(scale * (x - mean) + shift), all (rows, channels).
inline void affine_relu(const float* x, Affine a, int64_t rows, int64_t channels, float* y,
                        const Parallel& parallel) {
  parallel.run(rows, 1 + channels / 4, [=](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      affine_relu_row(x + r * channels, a.mean, a.scale, a.shift, channels, y + r * channels);
    }
  });
}

inline void add_grad_row(const float* __restrict grad, const float* __restrict x, Affine a,
                         int64_t channels, float* __restrict first, float* __restrict second) {
  const float* __restrict mean = a.mean;
  const float* __restrict scale = a.scale;
  const float* __restrict shift = a.shift;
  for (int64_t c = 0; c < channels; ++c) {
    const float d = x[c] - mean[c];
    const float g = d * scale[c] + shift[c] > 0.0F ? grad[c] : 0.0F;
    first[c] += g;
    second[c] += g * d;
  }
}

// Through the ReLU: sums of grad and of grad * (x - mean), each (channels).
inline void grad_sums(const float* grad, const float* x, Affine a, int64_t rows, int64_t channels,
                      double* total, const Parallel& parallel) {
  const int64_t blocks = (rows + kBlock - 1) / kBlock, width = 2 * channels;
  std::vector<float> partial(static_cast<size_t>(blocks * width), 0.0F);
  parallel.run(blocks, kBlock * (1 + channels / 2), [&](int64_t first, int64_t last) {
    for (int64_t b = first; b < last; ++b) {
      float* sums = partial.data() + b * width;
      for (int64_t r = b * kBlock; r < std::min(rows, (b + 1) * kBlock); ++r) {
        add_grad_row(grad + r * channels, x + r * channels, a, channels, sums, sums + channels);
      }
    }
  });
  std::fill_n(total, width, 0.0);
  for (int64_t i = 0; i < blocks * width; ++i) {
    total[i % width] += static_cast<double>(partial[static_cast<size_t>(i)]);
  }
}

// out = scale * (grad through the ReLU) + slope * (x - mean) + offset, per channel.
inline void grad_row(const float* __restrict grad, const float* __restrict x, Affine a,
                     GradAffine b, int64_t channels, float* __restrict out) {
  const float* __restrict mean = a.mean;
  const float* __restrict scale = a.scale;
  const float* __restrict shift = a.shift;
  const float* __restrict slope = b.slope;
  const float* __restrict offset = b.offset;
  for (int64_t c = 0; c < channels; ++c) {
    const float d = x[c] - mean[c];
    const float g = d * scale[c] + shift[c] > 0.0F ? grad[c] : 0.0F;
    out[c] = scale[c] * g + (slope[c] * d + offset[c]);
  }
}

inline void affine_relu_grad(const float* grad, const float* x, Affine a, GradAffine b,
                             int64_t rows, int64_t channels, float* out, const Parallel& parallel) {
  parallel.run(rows, 1 + channels / 2, [=](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      grad_row(grad + r * channels, x + r * channels, a, b, channels, out + r * channels);
    }
  });
}

inline void add_extreme_row(const float* __restrict row, const float* __restrict sign, int32_t k,
                            int64_t channels, float* __restrict best, int32_t* __restrict place,
                            float* __restrict sum) {
  for (int64_t c = 0; c < channels; ++c) {
    sum[c] += row[c];
    const bool better = sign[c] * row[c] > sign[c] * best[c];
    best[c] = better ? row[c] : best[c];
    place[c] = better ? k : place[c];
  }
}

// Moments of x (groups * size, channels), and of each group and channel the largest value (the
// smallest where sign is -1) with its place in the group; ties go to the first.
inline void moments_and_extremes(const float* x, const float* sign, int64_t groups, int64_t size,
                                 int64_t channels, float* mean, float* variance, float* best,
                                 int32_t* place, const Parallel& parallel) {
  const int64_t part = std::max<int64_t>(1, kBlock / size) * size;  // rows of whole groups
  moments(x, groups * size, part, channels, mean, variance, parallel,
          [=](int64_t begin, int64_t end, float* total) {
            for (int64_t r = begin; r < end; ++r) {
              const float* row = x + r * channels;
              float* group_best = best + r / size * channels;
              int32_t* group_place = place + r / size * channels;
              if (r % size == 0) {
                std::copy_n(row, channels, group_best);
                std::fill_n(group_place, channels, 0);
              }
              add_extreme_row(row, sign, static_cast<int32_t>(r % size), channels, group_best,
                              group_place, total);
            }
          });
}

inline void pooled_grad_row(const float* __restrict x, const float* __restrict spike,
                            const int32_t* __restrict place, int32_t k, GradAffine b,
                            int64_t channels, float* __restrict out) {
  const float* __restrict mean = b.mean;
  const float* __restrict slope = b.slope;
  const float* __restrict offset = b.offset;
  for (int64_t c = 0; c < channels; ++c) {
    const float at = place[c] == k ? spike[c] : 0.0F;
    out[c] = at + (slope[c] * (x[c] - mean[c]) + offset[c]);
  }
}

// Gradient of x (groups * size, channels): slope * (x - mean) + offset, and spike (groups,
// channels) added at `place` of each group.
inline void pooled_grad(const float* x, const float* spike, const int32_t* place, GradAffine b,
                        int64_t groups, int64_t size, int64_t channels, float* out,
                        const Parallel& parallel) {
  parallel.run(groups, size * (1 + channels / 2), [=](int64_t begin, int64_t end) {
    for (int64_t g = begin; g < end; ++g) {
      for (int64_t k = 0; k < size; ++k) {
        const int64_t row = (g * size + k) * channels;
        pooled_grad_row(x + row, spike + g * channels, place + g * channels,
                        static_cast<int32_t>(k), b, channels, out + row);
      }
    }
  });
}

}  // namespace ptn::PTN_ISA
