/* SPDX-License-Identifier: Apache-2.0 */
/* A temporary folder for the files of one test program, and a function to write small files into it. */
#ifndef PAGS_TESTS_SCRATCH_FOLDER_H
#define PAGS_TESTS_SCRATCH_FOLDER_H

#include <stdio.h>
#include <stdlib.h>

#include "base/file.h"
#include "system.h"

enum { SCRATCH_PATH = 512 };

/* The folder's path: scratch_make creates it, scratch_remove removes it with its contents. */
static char scratch_folder[SCRATCH_PATH];

static inline int scratch_make(void) {
  return system_make_scratch(scratch_folder, sizeof scratch_folder) ? 0 : -1;
}

static inline int scratch_remove(void) {
  return pags_remove_tree(scratch_folder) == PAGS_OK ? 0 : -1;
}

/* Set-up and tear-down of the folder for a group of cmocka tests. */
static inline int scratch_setup(void **state) {
  (void)state;
  return scratch_make();
}

static inline int scratch_teardown(void **state) {
  (void)state;
  return scratch_remove();
}

/* Returns the path of `name` in the folder; valid until four more calls. */
static inline const char *scratch(const char *name) {
  static char paths[4][SCRATCH_PATH + 128];
  static int next;
  char *path = paths[next++ % 4];
  snprintf(path, sizeof paths[0], "%s/%s", scratch_folder, name);
  return path;
}

/* Writes a file in the folder and returns its path. */
static inline const char *scratch_file(const char *name, const void *bytes, size_t size) {
  const char *path = scratch(name);
  FILE *stream = fopen(path, "wb");
  if (!stream || fwrite(bytes, 1, size, stream) != size || fclose(stream) != 0)
    abort();
  return path;
}

#endif
