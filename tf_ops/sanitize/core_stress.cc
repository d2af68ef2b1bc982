// Runs every algorithm in every instruction set of this processor, from several threads at once
// and over real threads, and compares with plain loops. Built with sanitizers and without
// TensorFlow, so that the thread sanitizer sees all of the synchronisation.

#include <cstdlib>

#include "sanitize/stress.h"

int main() {
  const stress::Sets sets = ptn::all_kernels();
  std::vector<std::thread> callers;
  for (uint32_t caller = 0; caller < 3; ++caller) {
    callers.emplace_back([&sets, caller] {
      stress::clouds(sets, caller);
      stress::normalization(sets, caller);
      stress::rows(sets, caller);
      stress::boxes(caller);
    });
  }
  for (std::thread& caller : callers) caller.join();
  for (const ptn::Kernels* set : sets) std::printf("%s ", set->name);
  std::printf(stress::failures == 0 ? "agree\n" : "DIFFER\n");
  return stress::failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
