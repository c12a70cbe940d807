/* SPDX-License-Identifier: Apache-2.0 */
/* Inflates the strips or tiles of a TIFF (TIFF 6.0 and BigTIFF) to see whether their checksums hold; see other.h. */
#include <zlib.h>

#include "base/file.h"
#include "base/memory.h"
#include "image/other.h"

enum { COMPRESSION = 259, STRIP_PLACES = 273, STRIP_SIZES = 279, TILE_PLACES = 324, TILE_SIZES = 325 };
enum { DEFLATE = 8, OLD_DEFLATE = 32946 };

typedef struct tiff {
  const uint8_t *bytes;
  uint64_t size;
  bool big_endian, big; /* BigTIFF */
} tiff;

/* A field of the directory: `count` numbers of `width` bytes at `at`. */
typedef struct field {
  uint64_t at, count;
  int width;
} field;

/* The number of `width` bytes at `at`; 0 beyond the end of the file. */
static uint64_t number(const tiff *t, uint64_t at, int width) {
  uint64_t value = 0;
  if (at > t->size || t->size - at < (uint64_t)width)
    return 0;
  for (int k = 0; k < width; k++)
    value |= (uint64_t)t->bytes[at + (uint64_t)k] << 8 * (t->big_endian ? width - 1 - k : k);
  return value;
}

static uint64_t element(const tiff *t, const field *f, uint64_t i) {
  return i < f->count ? number(t, f->at + i * (uint64_t)f->width, f->width) : 0;
}

/* Reads the field at `at` if its numbers are whole; `count` 0 otherwise. */
static field read_field(const tiff *t, uint64_t at) {
  const uint64_t type = number(t, at + 2, 2), word = t->big ? 8 : 4;
  const int width = type == 3 ? 2 : type == 4 ? 4 : type == 16 ? 8 : 0;
  field f = {.count = width ? number(t, at + 4, (int)word) : 0, .width = width};
  f.at = f.count > word / (uint64_t)(width ? width : 1) ? number(t, at + 4 + word, (int)word) : at + 4 + word;
  if (f.count > t->size)
    f.count = 0;
  return f;
}

/* Whether a zlib stream of `size` bytes inflates to its end; its checksum is the last thing in it. */
static pags_result inflate_all(const char *path, const uint8_t *bytes, uint64_t size) {
  uint8_t out[1 << 14];
  z_stream stream = {.next_in = (Bytef *)(uintptr_t)bytes, .avail_in = (uInt)size};
  PAGS_CHECK_MEMORY(inflateInit(&stream) == Z_OK, "%s", path);
  int status = Z_OK;
  while (status == Z_OK) {
    stream.next_out = out;
    stream.avail_out = sizeof out;
    status = inflate(&stream, Z_NO_FLUSH);
  }
  inflateEnd(&stream);
  return status == Z_STREAM_END ? PAGS_OK
                                : pags_fail_at(path, "can't be decoded: its compressed pixels are damaged or cut off");
}

pags_result pags_tiff_check(const char *path) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  uint8_t head[4] = {0};
  size_t size = pags_file_head(path, head, sizeof head);
  tiff t = {.bytes = head, .size = sizeof head, .big_endian = head[0] == 'M'};
  const uint64_t version = number(&t, 2, 2);
  if (size < sizeof head || (memcmp(head, "II", 2) != 0 && memcmp(head, "MM", 2) != 0) ||
      (version != 42 && version != 43))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  t = (tiff){.bytes = bytes, .size = size, .big_endian = t.big_endian, .big = version == 43};
  const uint64_t first = t.big ? number(&t, 8, 8) : number(&t, 4, 4);
  const uint64_t fields = number(&t, first, t.big ? 8 : 2), entry = t.big ? 20 : 12;
  uint64_t compression = 0;
  field places = {0}, sizes = {0};
  for (uint64_t i = 0; i < fields && i < 65536; i++) {
    const uint64_t at = first + (t.big ? 8 : 2) + i * entry, tag = number(&t, at, 2);
    const field f = read_field(&t, at);
    compression = tag == COMPRESSION ? element(&t, &f, 0) : compression;
    places = tag == STRIP_PLACES || tag == TILE_PLACES ? f : places;
    sizes = tag == STRIP_SIZES || tag == TILE_SIZES ? f : sizes;
  }
  if (compression != DEFLATE && compression != OLD_DEFLATE)
    return PAGS_OK;
  uint64_t sum = 0; /* strips don't overlap: a file that says so isn't looked at any longer */
  for (uint64_t i = 0; i < places.count && i < sizes.count && sum <= t.size; i++) {
    const uint64_t at = element(&t, &places, i), length = element(&t, &sizes, i);
    sum += length < t.size ? length : t.size;
    if (at > t.size || length > t.size - at || length > UINT32_MAX)
      return pags_fail_at(path, "can't be decoded: the file is cut off");
    if (length > 0) /* 0: a sparse file's, which is blank */
      PAGS_TRY(inflate_all(path, t.bytes + at, length));
  }
  return PAGS_OK;
}
