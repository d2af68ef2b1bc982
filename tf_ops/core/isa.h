// The instruction set that the including file is compiled for: PTN_ISA, a namespace, and PTN_SIMD,
// the width of its registers in bits (512, 256 or 0). A file that sets neither gets the portable
// one. Standard headers are included here, before the compiler is switched to an instruction set:
// standard templates stay portable, and the algorithms' own do not leave PTN_ISA.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <vector>

#include "core/kernels.h"
#include "core/prefetch.h"

#if defined(__x86_64__)
#  if defined(__GNUC__) && !defined(__clang__)
#    pragma GCC diagnostic push  // GCC 12 warns of this very header (GCC bug 105593)
#    pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#    pragma GCC diagnostic ignored "-Wuninitialized"
#  endif
#  include <immintrin.h>
#  if defined(__GNUC__) && !defined(__clang__)
#    pragma GCC diagnostic pop
#  endif
#endif

#if !defined(PTN_ISA)
#  define PTN_ISA portable
#  if defined(__AVX512F__) && defined(__AVX512DQ__)
#    define PTN_SIMD 512
#  elif defined(__AVX2__)
#    define PTN_SIMD 256
#  else
#    define PTN_SIMD 0
#  endif
#endif

namespace ptn {

using Mask = uint32_t;  // bit i: lane i of sixteen

}  // namespace ptn
