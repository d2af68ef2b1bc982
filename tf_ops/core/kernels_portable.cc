#include "core/kernels_std.h"

#define PTN_ISA portable
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#  define PTN_SIMD 512
#elif defined(__AVX2__)
#  define PTN_SIMD 256
#else
#  define PTN_SIMD 0
#endif
#include "core/kernels_isa.h"
