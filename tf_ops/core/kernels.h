// The algorithms whose inner loops are compiled once per instruction set; `kernels()` picks the
// best set that this processor has. Plain pointers, row-major arrays, coordinates finite.
#pragma once

#include <cstdint>

#include "core/parallel.h"

namespace ptn {

// A batch of clouds: `batch` clouds of `size` points, x y z each.
struct Clouds {
  const float* xyz;
  int64_t batch;
  int64_t size;
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

  // The k smallest of each of `rows` rows of `columns` values, smallest first. Needs columns >= 1.
  void (*select_top_k)(const float* values, int64_t rows, int64_t columns, int32_t k,
                       float* smallest, int32_t* index, const Parallel&);
};

// The table for this processor; chosen once.
const Kernels& kernels();

}  // namespace ptn
