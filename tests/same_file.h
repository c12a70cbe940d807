/* SPDX-License-Identifier: Apache-2.0 */
/* Compares files byte by byte. */
#ifndef PAGS_TESTS_SAME_FILE_H
#define PAGS_TESTS_SAME_FILE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/file.h"

static inline void assert_same_file(const char *a, const char *b) {
  uint8_t *left, *right;
  size_t left_size, right_size;
  if (pags_file_read(a, &left, &left_size) != PAGS_OK || pags_file_read(b, &right, &right_size) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  if (left_size != right_size || memcmp(left, right, left_size) != 0)
    fail_msg("%s and %s differ", a, b);
  free(left);
  free(right);
}

#endif
