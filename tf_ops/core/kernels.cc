#include <cstdlib>
#include <cstring>
#include <string>

#include "core/all_kernels.h"

namespace ptn {

namespace portable {
extern const Kernels kKernels;
}
#if defined(__x86_64__) && !defined(PTN_NATIVE)
namespace avx2 {
extern const Kernels kKernels;
}
namespace avx512 {
extern const Kernels kKernels;
}
#endif

std::vector<const Kernels*> all_kernels() {
  std::vector<const Kernels*> found;
#if defined(__x86_64__) && !defined(PTN_NATIVE)
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) {
    found.push_back(&avx512::kKernels);
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi")) {
    found.push_back(&avx2::kKernels);
  }
#endif
  found.push_back(&portable::kKernels);
  return found;
}

// An unknown name is refused by load_library() in loading.py, not here.
static const Kernels& choose() {
  const std::vector<const Kernels*> found = all_kernels();
  const char* name = std::getenv("TF_OPS_INSTRUCTIONS");
  for (const Kernels* set : found) {
    if (name == nullptr || std::strcmp(name, set->name) == 0) return *set;
  }
  return *found.front();
}

const Kernels& kernels() {
  static const Kernels& chosen = choose();
  return chosen;
}

}  // namespace ptn

// Names of the instruction sets to choose from, with a space between; for loading.py.
extern "C" __attribute__((visibility("default"))) const char* ptn_instruction_sets() {
  static const std::string names = [] {
    std::string text;
    for (const ptn::Kernels* set : ptn::all_kernels()) {
      text += (text.empty() ? "" : " ") + std::string(set->name);
    }
    return text;
  }();
  return names.c_str();
}
