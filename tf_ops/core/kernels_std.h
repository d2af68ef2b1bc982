// Standard headers of the algorithms, to be included before the instruction set is switched.
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
