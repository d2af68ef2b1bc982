// The instruction sets to choose from.
#pragma once

#include <vector>

#include "core/kernels.h"

namespace ptn {

// The tables that this processor can run, the widest instruction set first. `kernels()` is the
// first of them, or the one that the environment's TF_OPS_INSTRUCTIONS names.
std::vector<const Kernels*> all_kernels();

}  // namespace ptn
