// Asking for memory before it is read.
#pragma once

#include <algorithm>
#include <cstddef>

namespace ptn {

// Asks for the cache lines of a row that will soon be read, the first few: the processor goes on
// from there by itself.
inline void prefetch_row(const void* row, size_t bytes) {
  constexpr size_t kLine = 64, kMost = 8 * kLine;
  for (size_t i = 0; i < std::min(bytes, kMost); i += kLine) {
    __builtin_prefetch(static_cast<const char*>(row) + i);
  }
}

}  // namespace ptn
