// Everything that is compiled once per instruction set. The including file has set PTN_SIMD (512,
// 256 or 0) and PTN_ISA (a namespace), included the standard headers below, and switched the
// compiler to that instruction set: standard templates stay portable, ours do not leave PTN_ISA.

namespace ptn {
namespace PTN_ISA {

#include "core/simd.h"
// After simd.h:
#include "core/aligned.h"
// After aligned.h:
#include "core/kd_order.h"
// After kd_order.h:
#include "core/kd_tree.h"
// After kd_tree.h:
#include "core/nodes.h"
// After nodes.h:
#include "grouping/nearest_few.h"
#include "grouping/nearest_many.h"
// After nearest_few.h and nearest_many.h:
#include "grouping/group_difference.h"
#include "grouping/knn_point.h"
#include "grouping/query_ball_point.h"
#include "normalization/batch_norm.h"
#include "sampling/farthest_point_sample.h"

#define PTN_STRING_(x) #x
#define PTN_STRING(x) PTN_STRING_(x)

extern const Kernels kKernels;
const Kernels kKernels = {PTN_STRING(PTN_ISA), farthest_point_sample, query_ball_point,
                          knn_point,           select_top_k,          group_difference,
                          column_moments,      affine_relu,           grad_sums,
                          affine_relu_grad,    moments_and_extremes,  pooled_grad};

}  // namespace PTN_ISA
}  // namespace ptn
