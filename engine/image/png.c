/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the lengths of the chunks of a PNG file (ISO/IEC 15948, 5.3: length, type, data, CRC) up to its pixels. */
#include "image/png.h"

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "base/file.h"

enum { SIGNATURE = 8, HEAD = 8, CHECKSUM = 4 };

static pags_result walk(const char *path, FILE *file, uint64_t size) {
  uint8_t head[HEAD];
  for (uint64_t at = SIGNATURE; fread(head, HEAD, 1, file) == 1 && memcmp(head + 4, "IDAT", 4) != 0;) {
    const uint32_t length = (uint32_t)head[0] << 24 | (uint32_t)head[1] << 16 | (uint32_t)head[2] << 8 | head[3];
    const uint64_t end = at + HEAD + length + CHECKSUM;
    if (end > size)
      return pags_fail(
          PAGS_ERROR_FORMAT,
          "%s: not a readable picture: the chunk at byte %llu is to hold %u bytes, the file ends at byte %llu", path,
          (unsigned long long)at, (unsigned)length, (unsigned long long)size);
    at = end;
    if (fseek(file, (long)at, SEEK_SET) != 0)
      break;
  }
  return PAGS_OK;
}

pags_result pags_png_check_chunks(const char *path) {
  static const uint8_t signature[SIGNATURE] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  uint8_t begin[SIGNATURE];
  uint64_t size;
  FILE *const file = fopen(path, "rb");
  if (!file)
    return PAGS_OK;
  pags_result result = PAGS_OK;
  if (fread(begin, sizeof begin, 1, file) == 1 && memcmp(begin, signature, sizeof begin) == 0 &&
      pags_file_size(path, &size) == PAGS_OK)
    result = walk(path, file, size);
  fclose(file);
  return result;
}
