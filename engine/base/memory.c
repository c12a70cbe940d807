/* SPDX-License-Identifier: Apache-2.0 */
/* The error for memory that cannot be allocated, and arrays that grow (base/memory.h). */
#include "base/memory.h"

#include <stdarg.h>
#include <stdio.h>

pags_result pags_out_of_memory(const char *what, ...) {
  if (!what)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
  char text[1024];
  va_list arguments;
  va_start(arguments, what);
  vsnprintf(text, sizeof text, what, arguments);
  va_end(arguments);
  return pags_fail(PAGS_ERROR_MEMORY, "out of memory for %s", text);
}

bool pags_grow(void *list, int64_t needed, int64_t *capacity, size_t size) {
  if (needed <= *capacity)
    return true;
  int64_t larger = *capacity ? 2 * *capacity : 64;
  if (larger < needed)
    larger = needed;
  void *items;
  memcpy(&items, list, sizeof items);
  items = (uint64_t)larger <= SIZE_MAX / size ? realloc(items, (size_t)larger * size) : NULL;
  if (!items)
    return false;
  memcpy(list, &items, sizeof items);
  *capacity = larger;
  return true;
}
