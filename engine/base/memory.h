/* SPDX-License-Identifier: Apache-2.0 */
/* Memory that is released at the end of a scope, on every path, and the error for memory that cannot be allocated, with
 * the same wording everywhere.
 *
 *   PAGS_AUTOFREE char *path = pags_path_join(folder, name);
 *   PAGS_CHECK_MEMORY(path, "%s", folder);
 *   PAGS_AUTO(pags_image_destroy) pags_image image = {0};
 *   PAGS_TRY(pags_image_load(path, PAGS_F32, &image));
 *   *out = pags_take(&path);  // the caller's from here: this scope frees nothing
 */
#ifndef PAGS_BASE_MEMORY_H
#define PAGS_BASE_MEMORY_H

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Fails with PAGS_ERROR_MEMORY and "out of memory for WHAT", or "out of memory" if `what` is NULL. WHAT is `what`
 * formatted as by printf; it names the thing that memory was needed for, with its size if known, or the file that was
 * being read or written. */
pags_result pags_out_of_memory(const char *what, ...) PAGS_PRINTF(1, 2);

/* Returns with the error above unless `pointer` (or an expression such as a && b) is set. */
#define PAGS_CHECK_MEMORY(pointer, ...)       \
  do {                                        \
    if (!(pointer))                           \
      return pags_out_of_memory(__VA_ARGS__); \
  } while (0)

/* Before the declaration of a variable: `release(&variable)` runs where its scope ends. Initialise the variable in its
 * declaration (to zero or NULL, if `release` takes that), and don't jump over the declaration. It may be unused
 * otherwise. */
#define PAGS_AUTO(release) __attribute__((cleanup(release), unused))

/* Before the declaration of a pointer: it is freed where its scope ends. */
#define PAGS_AUTOFREE PAGS_AUTO(pags_autofree)

static inline void pags_autofree(void *pointer) {
  void *memory;
  memcpy(&memory, pointer, sizeof memory);
  free(memory);
}

/* Returns the pointer at `pointer` and sets it to NULL: its owner is the caller now. */
static inline void *pags_take(void *pointer) {
  void *memory;
  memcpy(&memory, pointer, sizeof memory);
  memset(pointer, 0, sizeof memory);
  return memory;
}

/* Makes room for `needed` items of `size` bytes in the growing array at `list`, the address of a pointer, by doubling
 * its capacity at least. False if out of memory; the array is unchanged then.
 *
 *   PAGS_CHECK_MEMORY(pags_grow(&rows->items, rows->count + 1, &rows->capacity, sizeof *rows->items), "%s", path); */
bool pags_grow(void *list, int64_t needed, int64_t *capacity, size_t size);

/* Defines DESTROY_auto for PAGS_AUTO from a function that destroys what a `type *` points to and takes NULL:
 * PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL; */
#define PAGS_DEFINE_AUTO(type, destroy)               \
  static inline void destroy##_auto(type **pointer) { \
    destroy(*pointer);                                \
  }

#ifdef __cplusplus
}
#endif
#endif
