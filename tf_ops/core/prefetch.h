// Prefetching of rows before they are read.
#pragma once

#include <algorithm>
#include <cstddef>

namespace ptn {

// Prefetches the first cache lines of a row; the hardware prefetcher continues from there.
inline void prefetch_row(const void* row, size_t bytes) {
  constexpr size_t kLine = 64, kMost = 8 * kLine;
  for (size_t i = 0; i < std::min(bytes, kMost); i += kLine) {
    __builtin_prefetch(static_cast<const char*>(row) + i);
  }
}

}  // namespace ptn
