// Everything that is compiled once per instruction set. The including file has set PTN_SIMD (512,
// 256 or 0) and PTN_ISA (a namespace), included the standard headers below, and switched the
// compiler to that instruction set: standard templates stay portable, ours do not leave PTN_ISA.

namespace ptn {
namespace PTN_ISA {

#include "core/simd.h"
// After simd.h:
#include "core/kd_tree.h"
// After kd_tree.h:
#include "grouping/nearest.h"
// After nearest.h:
#include "grouping/knn_point.h"
#include "grouping/query_ball_point.h"
#include "sampling/farthest_point_sample.h"

#define PTN_STRING_(x) #x
#define PTN_STRING(x) PTN_STRING_(x)

extern const Kernels kKernels;
const Kernels kKernels = {PTN_STRING(PTN_ISA), farthest_point_sample, query_ball_point, knn_point,
                          select_top_k};

}  // namespace PTN_ISA
}  // namespace ptn
