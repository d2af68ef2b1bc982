// Batch normalisation with ReLU, and with ReLU and maximum over neighbours, forward and backward.
// Rows of `channels` values; one pass over the rows where that is enough. Sums are made over
// blocks of kBlock rows in float32 and added in order in float64: the result does not depend on
// the number of threads. Included once per instruction set (see kernels_isa.h).

constexpr int64_t kBlock = 256;

// Adds up `kSums` rows of channel sums over the blocks of all rows, in order, in float64.
// add(begin, end, sums) adds the rows [begin, end) to the float32 sums (kSums * channels).
template <int kSums, class Add>
void block_sums(int64_t rows, int64_t channels, int64_t cost, double* total,
                const Parallel& parallel, const Add& add) {
  const int64_t width = kSums * channels;
  const int64_t blocks = (rows + kBlock - 1) / kBlock;
  std::vector<float> partial(static_cast<size_t>(blocks * width), 0.0F);
  parallel.run(blocks, cost * kBlock, [&](int64_t first, int64_t last) {
    for (int64_t block = first; block < last; ++block) {
      add(block * kBlock, std::min(rows, (block + 1) * kBlock), partial.data() + block * width);
    }
  });
  std::fill_n(total, width, 0.0);
  for (int64_t block = 0; block < blocks; ++block) {
    const float* sums = partial.data() + block * width;
    for (int64_t i = 0; i < width; ++i) total[i] += static_cast<double>(sums[i]);
  }
}

// Mean and (biased) variance from sums of x - origin and of its square.
inline void moments_from(const double* total, const float* origin, int64_t rows, int64_t channels,
                         float* mean, float* variance) {
  for (int64_t c = 0; c < channels; ++c) {
    const double first = total[c] / static_cast<double>(rows);
    const double second = total[channels + c] / static_cast<double>(rows);
    mean[c] = static_cast<float>(first + static_cast<double>(origin[c]));
    variance[c] = static_cast<float>(std::max(second - first * first, 0.0));
  }
}

inline void add_moments(const float* __restrict row, const float* __restrict origin,
                        int64_t channels, float* __restrict first, float* __restrict second) {
  for (int64_t c = 0; c < channels; ++c) {
    const float d = row[c] - origin[c];
    first[c] += d;
    second[c] += d * d;
  }
}

// mean, variance (channels) of x (rows, channels); rows >= 1.
inline void column_moments(const float* x, int64_t rows, int64_t channels, float* mean,
                           float* variance, const Parallel& parallel) {
  std::vector<double> total(static_cast<size_t>(2 * channels));
  block_sums<2>(rows, channels, 1 + channels / 4, total.data(), parallel,
                [=](int64_t begin, int64_t end, float* sums) {
                  for (int64_t r = begin; r < end; ++r) {
                    add_moments(x + r * channels, x, channels, sums, sums + channels);
                  }
                });
  moments_from(total.data(), x, rows, channels, mean, variance);
}

inline void affine_relu_row(const float* x, const float* __restrict scale,
                            const float* __restrict shift, int64_t channels, float* y) {
  for (int64_t c = 0; c < channels; ++c) {
    const float value = x[c] * scale[c] + shift[c];
    y[c] = value > 0.0F ? value : 0.0F;
  }
}

// y = relu(scale * x + shift), all (rows, channels).
inline void affine_relu(const float* x, Affine a, int64_t rows, int64_t channels, float* y,
                        const Parallel& parallel) {
  parallel.run(rows, 1 + channels / 4, [=](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      affine_relu_row(x + r * channels, a.scale, a.shift, channels, y + r * channels);
    }
  });
}

inline void add_grad_row(const float* __restrict grad, const float* __restrict x, Affine a,
                         const float* __restrict mean, int64_t channels, float* __restrict first,
                         float* __restrict second) {
  const float* __restrict scale = a.scale;
  const float* __restrict shift = a.shift;
  for (int64_t c = 0; c < channels; ++c) {
    const float g = x[c] * scale[c] + shift[c] > 0.0F ? grad[c] : 0.0F;
    first[c] += g;
    second[c] += g * (x[c] - mean[c]);
  }
}

// Through the ReLU: sum of grad, and of grad * (x - mean), each (channels).
inline void grad_sums(const float* grad, const float* x, Affine a, const float* mean, int64_t rows,
                      int64_t channels, double* total, const Parallel& parallel) {
  block_sums<2>(rows, channels, 1 + channels / 2, total, parallel,
                [=](int64_t begin, int64_t end, float* sums) {
                  for (int64_t r = begin; r < end; ++r) {
                    add_grad_row(grad + r * channels, x + r * channels, a, mean, channels, sums,
                                 sums + channels);
                  }
                });
}

// out = scale * (grad through the ReLU) + slope * x + offset, per channel.
inline void grad_row(const float* __restrict grad, const float* __restrict x, Affine a,
                     GradAffine b, int64_t channels, float* __restrict out) {
  const float* __restrict scale = a.scale;
  const float* __restrict shift = a.shift;
  const float* __restrict slope = b.slope;
  const float* __restrict offset = b.offset;
  for (int64_t c = 0; c < channels; ++c) {
    const float g = x[c] * scale[c] + shift[c] > 0.0F ? grad[c] : 0.0F;
    out[c] = scale[c] * g + (slope[c] * x[c] + offset[c]);
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

inline void add_extreme_row(const float* __restrict row, const float* __restrict origin,
                            const float* __restrict sign, int32_t k, int64_t channels,
                            float* __restrict best, int32_t* __restrict place,
                            float* __restrict first, float* __restrict second) {
  for (int64_t c = 0; c < channels; ++c) {
    const float d = row[c] - origin[c];
    first[c] += d;
    second[c] += d * d;
    const bool better = sign[c] * row[c] > sign[c] * best[c];
    best[c] = better ? row[c] : best[c];
    place[c] = better ? k : place[c];
  }
}

// Moments of x (groups * size, channels), and of each group and channel the largest value (the
// smallest where sign is -1) with its place in the group; ties go to the first. One pass.
inline void moments_and_extremes(const float* x, const float* sign, int64_t groups, int64_t size,
                                 int64_t channels, float* mean, float* variance, float* best,
                                 int32_t* place, const Parallel& parallel) {
  const int64_t block = std::max<int64_t>(1, kBlock / size);  // groups, not rows
  const int64_t blocks = (groups + block - 1) / block;
  const int64_t width = 2 * channels;
  std::vector<float> partial(static_cast<size_t>(blocks * width), 0.0F);
  parallel.run(blocks, block * size * (1 + channels / 2), [&](int64_t begin, int64_t end) {
    for (int64_t b = begin; b < end; ++b) {
      float* sums = partial.data() + b * width;
      for (int64_t g = b * block; g < std::min(groups, (b + 1) * block); ++g) {
        const float* rows = x + g * size * channels;
        std::copy_n(rows, channels, best + g * channels);
        std::fill_n(place + g * channels, channels, 0);
        for (int64_t k = 0; k < size; ++k) {
          add_extreme_row(rows + k * channels, x, sign, static_cast<int32_t>(k), channels,
                          best + g * channels, place + g * channels, sums, sums + channels);
        }
      }
    }
  });
  std::vector<double> total(static_cast<size_t>(width), 0.0);
  for (int64_t i = 0; i < blocks * width; ++i) {
    total[static_cast<size_t>(i % width)] += static_cast<double>(partial[static_cast<size_t>(i)]);
  }
  moments_from(total.data(), x, groups * size, channels, mean, variance);
}

inline void pooled_grad_row(const float* __restrict x, const float* __restrict spike,
                            const int32_t* __restrict place, int32_t k, GradAffine b,
                            int64_t channels, float* __restrict out) {
  const float* __restrict slope = b.slope;
  const float* __restrict offset = b.offset;
  for (int64_t c = 0; c < channels; ++c) {
    const float at = place[c] == k ? spike[c] : 0.0F;
    out[c] = at + (slope[c] * x[c] + offset[c]);
  }
}

// Gradient of x (groups * size, channels): slope * x + offset everywhere, and spike (groups,
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
