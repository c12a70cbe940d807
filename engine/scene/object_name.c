/* SPDX-License-Identifier: Apache-2.0 */
/* Implements object_name.h. */
#include "scene/object_name.h"

#include <stddef.h>
#include <stdio.h>

void pags_class_plain_name(const char *class_name, char out[PAGS_OBJECT_NAME]) {
  size_t i = 0;
  for (; class_name[i] && i + 16 < PAGS_OBJECT_NAME; i++) {
    const char c = class_name[i];
    out[i] = c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ? c : '_';
  }
  out[i] = 0;
}

void pags_object_plain_name(const char *class_name, int64_t number, char out[PAGS_OBJECT_NAME]) {
  char plain[PAGS_OBJECT_NAME];
  pags_class_plain_name(class_name, plain);
  snprintf(out, PAGS_OBJECT_NAME, "%.60s_%04lld", plain, (long long)number);
}
