#if defined(__x86_64__) && !defined(PTN_NATIVE)
#  define PTN_SIMD 512
#  define PTN_ISA avx512
#  include "core/isa.h"  // before the compiler is switched
#  if defined(__clang__)
#    pragma clang attribute push(__attribute__((target("avx512f,avx512dq,popcnt,bmi"))), \
                                 apply_to = function)
#  else
#    pragma GCC push_options
#    pragma GCC target("avx512f,avx512dq,popcnt,bmi")
#  endif
#  include "core/kernels_isa.h"
#  if defined(__clang__)
#    pragma clang attribute pop
#  else
#    pragma GCC pop_options
#  endif
#endif
