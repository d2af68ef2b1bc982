#include "core/kernels.h"

namespace ptn {

#if defined(PTN_NATIVE) || !defined(__x86_64__)

namespace portable {
extern const Kernels kKernels;
}

const Kernels& kernels() { return portable::kKernels; }

#else

namespace portable {
extern const Kernels kKernels;
}
namespace avx2 {
extern const Kernels kKernels;
}
namespace avx512 {
extern const Kernels kKernels;
}

static const Kernels& best() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw")) {
    return avx512::kKernels;
  }
  if (__builtin_cpu_supports("avx2")) return avx2::kKernels;
  return portable::kKernels;
}

const Kernels& kernels() {
  static const Kernels& chosen = best();
  return chosen;
}

#endif

}  // namespace ptn
