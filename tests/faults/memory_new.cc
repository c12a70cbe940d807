/* SPDX-License-Identifier: Apache-2.0 */
// operator new as our own C++ objects call it, failed by the memory guard as malloc is. What libstdc++ frees of it
// isn't counted.
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
