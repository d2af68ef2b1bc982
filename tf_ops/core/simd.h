// Sixteen floats or int32 at a time: one AVX-512 register, two AVX2 registers, or an array that the
// compiler vectorises for any other processor. Every operation rounds as the scalar one does (no
// fused multiply-add), so all instruction sets give the same bits. Loads and stores are aligned.
#pragma once

#include "core/isa.h"

#if PTN_SIMD == 512
#  include "core/simd_avx512.h"
#elif PTN_SIMD == 256
#  include "core/simd_avx2.h"
#else
#  include "core/simd_portable.h"
#endif

namespace ptn::PTN_ISA {

// Calls f(lane) for each set bit, lowest first.
template <class F>
inline void for_each_lane(Mask mask, F&& f) {
  for (; mask != 0; mask &= mask - 1) f(__builtin_ctz(mask));
}

struct Point16 {
  F16 x, y, z;
};

// The same point in every lane.
inline Point16 all_point(const float* p) { return {all(p[0]), all(p[1]), all(p[2])}; }

// Squared distances in float32, summed as (x + y) + z: the one formula of all ops.
inline F16 squared(F16 dx, F16 dy, F16 dz) { return (dx * dx + dy * dy) + dz * dz; }

inline F16 distance2(const Point16& a, const Point16& b) {
  return squared(a.x - b.x, a.y - b.y, a.z - b.z);
}

}  // namespace ptn::PTN_ISA
