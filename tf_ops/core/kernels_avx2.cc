#if defined(__x86_64__) && !defined(PTN_NATIVE)
#  define PTN_SIMD 256
#  define PTN_ISA avx2
#  include "core/isa.h"  // before the compiler is switched
#  if defined(__clang__)
#    pragma clang attribute push(__attribute__((target("avx2,popcnt,bmi"))), apply_to = function)
#  else
#    pragma GCC push_options
#    pragma GCC target("avx2,popcnt,bmi")
#  endif
#  include "core/kernels_isa.h"
#  if defined(__clang__)
#    pragma clang attribute pop
#  else
#    pragma GCC pop_options
#  endif
#endif
