#include "core/kernels.h"

#include <cstdlib>
#include <cstring>

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

// Of the instruction sets that this processor has, the one that TF_OPS_INSTRUCTIONS names (for
// tests and measurements), by default the widest.
static const Kernels& choose() {
  __builtin_cpu_init();
  const char* name = std::getenv("TF_OPS_INSTRUCTIONS");
  const auto wanted = [name](const Kernels& set) {
    return name == nullptr || std::strcmp(name, set.name) == 0;
  };
  if (wanted(avx512::kKernels) && __builtin_cpu_supports("avx512f") &&
      __builtin_cpu_supports("avx512dq")) {
    return avx512::kKernels;
  }
  if (wanted(avx2::kKernels) && __builtin_cpu_supports("avx2")) return avx2::kKernels;
  return portable::kKernels;
}

const Kernels& kernels() {
  static const Kernels& chosen = choose();
  return chosen;
}

#endif

}  // namespace ptn
