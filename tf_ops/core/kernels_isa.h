// The table of kernels of one instruction set; included once by the source file of each set.
#pragma once

#include "grouping/group_difference.h"
#include "grouping/knn_point.h"
#include "grouping/query_ball_point.h"
#include "normalization/batch_norm.h"
#include "sampling/farthest_point_sample.h"

#define PTN_STRING_(x) #x
#define PTN_STRING(x) PTN_STRING_(x)

namespace ptn::PTN_ISA {

extern const Kernels kKernels;
const Kernels kKernels = {PTN_STRING(PTN_ISA), farthest_point_sample, query_ball_point, knn_point,
                          group_difference,    column_moments,        affine_relu,      grad_sums,
                          affine_relu_grad,    moments_and_extremes,  pooled_grad};

}  // namespace ptn::PTN_ISA
