/* SPDX-License-Identifier: Apache-2.0 */
// Replaces operator new of this project's C++ objects. The memory guard makes it fail, like malloc. Blocks that
// libstdc++ frees aren't counted.
#include <cstddef>
#include <new>

extern "C" {
int memory_guard_allows(std::size_t size);
void *__real__Znwm(std::size_t size);
void *__wrap__Znwm(std::size_t size);
}

void *__wrap__Znwm(std::size_t size) {
  if (!memory_guard_allows(size))
    throw std::bad_alloc();
  return __real__Znwm(size);
}
