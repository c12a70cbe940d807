/* SPDX-License-Identifier: Apache-2.0 */
/* Checks that a JPEG file has its end-of-image marker (ITU-T T.81, annex B). */
#include "image/jpeg.h"

#include "base/file.h"

#include <stdbool.h>
#include <stdlib.h>

enum { START_OF_IMAGE = 0xd8, END_OF_IMAGE = 0xd9, START_OF_SCAN = 0xda };

/* Returns the byte at which the first scan begins; 0 if the segments before it are malformed, which is left for the
 * decoder to report. These segments must be skipped, because a thumbnail in them has an end-of-image marker of its
 * own. */
static size_t find_scan(const uint8_t *bytes, size_t size) {
  size_t at = 2;
  while (at + 4 <= size && bytes[at] == 0xff) {
    if (bytes[at + 1] == START_OF_SCAN)
      return at;
    if (bytes[at + 1] == 0xff)
      at += 1; /* padding */
    else
      at += 2 + ((size_t)bytes[at + 2] << 8 | bytes[at + 3]);
  }
  return 0;
}

/* Is there an end-of-image marker after byte `begin`? The search runs from the end of the file, because cameras
 * append data of their own after the marker, but not much. */
static bool has_end(const uint8_t *bytes, size_t begin, size_t size) {
  for (size_t i = size - 1; i > begin; i--)
    if (bytes[i] == END_OF_IMAGE && bytes[i - 1] == 0xff)
      return true;
  return false;
}

pags_result pags_jpeg_check_end(const char *path) {
  uint8_t *bytes;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  bool jpeg = size > 3 && bytes[0] == 0xff && bytes[1] == START_OF_IMAGE;
  size_t scan = jpeg ? find_scan(bytes, size) : 0;
  bool cut = scan > 0 && !has_end(bytes, scan, size);
  free(bytes);
  return cut ? pags_fail(PAGS_ERROR_FORMAT, "%s: can't be decoded: the file is cut off after %zu bytes", path, size)
             : PAGS_OK;
}
