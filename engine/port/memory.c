/* SPDX-License-Identifier: Apache-2.0 */
/* Aligned memory (port.h): C17's aligned_alloc, or Windows's pair of its own. */
#include "port/port.h"

#include <stdlib.h>
#ifdef _WIN32
#include <malloc.h>
#endif

void *pags_port_aligned_alloc(size_t alignment, size_t size) {
  if (size > SIZE_MAX - alignment)
    return NULL;
  const size_t rounded = (size + alignment - 1) & ~(alignment - 1); /* C17 asks for a multiple of the alignment */
#ifdef _WIN32
  return _aligned_malloc(rounded ? rounded : alignment, alignment);
#else
  return aligned_alloc(alignment, rounded ? rounded : alignment);
#endif
}

void pags_port_aligned_free(void *block) {
#ifdef _WIN32
  _aligned_free(block);
#else
  free(block);
#endif
}
