// The algorithms whose inner loops are compiled once per instruction set; `kernels()` returns the
// set of this processor. Plain pointers, row-major arrays, coordinates finite.
#pragma once

#include <cstdint>

#include "core/parallel.h"

namespace ptn {

// Per channel: y = relu(scale * (x - mean) + shift).
struct Affine {
  const float* mean;
  const float* scale;
  const float* shift;
};

// Per channel: slope * (x - mean) + offset, the part of a gradient that comes through the moments.
struct GradAffine {
  const float* mean;
  const float* slope;
  const float* offset;
};

// A batch of clouds: `batch` clouds of `size` points, x y z each.
struct Clouds {
  const float* xyz;
  int64_t batch;
  int64_t size;
};

// For each neighbour of a query: points[index] - query + pair weight, clipped at 0 if relu.
struct GroupDifference {
  int64_t batch, size, channels;  // points (batch, size, channels)
  int64_t queries, neighbours;    // index (batch, queries, neighbours), in range
  int64_t pairs;                  // pair (batch, queries, neighbours, pairs)
  const float* points;
  const int32_t* index;
  const float* query;   // (batch, queries, channels)
  const float* pair;    // unused if pairs is 0
  const float* weight;  // (pairs, channels)
  bool relu;
};

struct Kernels {
  const char* name;

  // index (batch, npoint). Needs size >= 1.
  void (*farthest_point_sample)(Clouds clouds, int32_t npoint, int32_t* index, const Parallel&);

  // index (batch, queries, nsample), count (batch, queries). Needs clouds.size >= 1.
  void (*query_ball_point)(Clouds clouds, Clouds queries, float radius, int32_t nsample,
                           int32_t* index, int32_t* count, const Parallel&);

  // dist2, index (batch, queries, k), nearest first. Needs clouds.size >= 1.
  void (*knn_point)(Clouds clouds, Clouds queries, int32_t k, float* dist2, int32_t* index,
                    const Parallel&);

  // grouped (batch, queries, neighbours, channels).
  void (*group_difference)(const GroupDifference&, float* grouped, const Parallel&);

  // Batch normalisation of rows of channels: see normalization/batch_norm.h.
  void (*column_moments)(const float* x, int64_t rows, int64_t channels, float* mean,
                         float* variance, const Parallel&);
  void (*affine_relu)(const float* x, Affine, int64_t rows, int64_t channels, float* y,
                      const Parallel&);
  void (*grad_sums)(const float* grad, const float* x, Affine, int64_t rows, int64_t channels,
                    double* total, const Parallel&);
  void (*affine_relu_grad)(const float* grad, const float* x, Affine, GradAffine, int64_t rows,
                           int64_t channels, float* out, const Parallel&);
  void (*moments_and_extremes)(const float* x, const float* sign, int64_t groups, int64_t size,
                               int64_t channels, float* mean, float* variance, float* best,
                               int32_t* place, const Parallel&);
  void (*pooled_grad)(const float* x, const float* spike, const int32_t* place, GradAffine,
                      int64_t groups, int64_t size, int64_t channels, float* out, const Parallel&);
};

// The table for this processor; chosen once.
const Kernels& kernels();

}  // namespace ptn
