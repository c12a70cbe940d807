/* SPDX-License-Identifier: Apache-2.0 */
/* Test data outside of the repository: in the folder named by PAGS_SHARED_DATA, or else in ../shared/data next to the
 * sources. */
#ifndef PAGS_TESTS_SHARED_DATA_H
#define PAGS_TESTS_SHARED_DATA_H

#include <stdio.h>
#include <stdlib.h>

#include "port/port.h"

/* Writes the path of `name` to `path` and returns 1 if that file or folder exists. Otherwise prints its name and
 * returns 0, and the test calls skip(). */
static inline int pags_shared_data(const char *name, char *path, size_t size) {
  const char *folder = getenv("PAGS_SHARED_DATA");
  if (folder)
    snprintf(path, size, "%s/%s", folder, name);
  else
    snprintf(path, size, "%s/../shared/data/%s", PAGS_SOURCE_DIR, name);
  pags_port_status status;
  if (pags_port_stat(path, true, &status))
    return 1;
  printf("skipped: needs %s (set PAGS_SHARED_DATA to the folder of the test data)\n", path);
  return 0;
}

#endif
