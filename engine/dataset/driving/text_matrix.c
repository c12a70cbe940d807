/* SPDX-License-Identifier: Apache-2.0 */
/* Reads text files of numbers as written by numpy's savetxt: poses, extrinsics, intrinsics. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool is_gap(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == ',';
}

/* `finite`: numbers that aren't finite are an error. */
static pags_result parse(const char *path, const char *text, size_t size, int capacity, bool finite, double *out,
                         int *count) {
  const char *at = text;
  int line = 1;
  for (*count = 0;; ++*count) {
    for (; is_gap(*at); at++)
      line += *at == '\n';
    if (*at == '\0' && at == text + size)
      return PAGS_OK;
    char *end;
    double value = pags_text_to_double(at, &end);
    if (end == at || (finite && !isfinite(value)) || (*end && !is_gap(*end)))
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a number, found '%.*s'", path, line,
                       (int)strcspn(at, " \t\r\n,") > 20 ? 20 : (int)strcspn(at, " \t\r\n,"), at);
    if (*count == capacity)
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected at most %d numbers, found more", path, line, capacity);
    out[*count] = value;
    at = end;
  }
}

pags_result pags_text_matrix_read(const char *path, int capacity, double *out, int *count) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return parse(path, (const char *)bytes, size, capacity, true, out, count);
}

bool pags_text_pose_is_missing(const char *path) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  double numbers[16];
  int count = 0, unknown = 0;
  if (!pags_file_exists(path))
    return true;
  if (pags_file_read(path, &bytes, &size) != PAGS_OK)
    return false;
  if (parse(path, (const char *)bytes, size, 16, false, numbers, &count) == PAGS_OK)
    for (int i = 0; i < count; i++)
      unknown += !isfinite(numbers[i]);
  return size == 0 || unknown > 0;
}

pags_result pags_text_pose_read(const char *path, double out[12]) {
  double numbers[16];
  int count;
  PAGS_TRY(pags_text_matrix_read(path, 16, numbers, &count));
  if (count != 16 && count != 12)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:1: expected a matrix of 4x4 numbers, found %d numbers", path, count);
  const double last[4] = {0, 0, 0, 1};
  for (int i = 0; i < 4 && count == 16; i++)
    if (fabs(numbers[12 + i] - last[i]) > 1e-6)
      return pags_fail(PAGS_ERROR_FORMAT, "%s:4: expected 0 0 0 1 as the matrix's last row", path);
  memcpy(out, numbers, 12 * sizeof *out);
  PAGS_AUTOFREE char *what = pags_text_format("%s:1", path);
  PAGS_CHECK_MEMORY(what, "%s", path);
  return pags_rigid_check(out, what);
}
