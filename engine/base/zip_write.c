/* SPDX-License-Identifier: Apache-2.0 */
/* Writes zip archives: their records, deflate by zlib. */
#include "base/zip.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/bytes.h"
#include "base/memory.h"

/* Level 1 takes less than half of the time of level 6, for 4 % more bytes of a sky. */
enum { DEFLATED = 8, LEVEL = 1 };

static void store16(uint8_t *p, unsigned value) {
  p[0] = (uint8_t)value;
  p[1] = (uint8_t)(value >> 8);
}

/* What both records of a member share: 26 bytes from the version that is needed on. */
static void put_shared(uint8_t *p, const pags_zip_item *item) {
  memset(p, 0, 26);
  store16(p, 20);
  store16(p + 4, item->packed ? DEFLATED : 0);
  store16(p + 8, 0x21); /* 1980-01-01 */
  pags_store_u32(p + 10, item->crc);
  pags_store_u32(p + 14, item->packed ? item->packed : item->size);
  pags_store_u32(p + 18, item->size);
  store16(p + 22, (unsigned)strlen(item->name));
}

size_t pags_zip_put_local(uint8_t *out, const pags_zip_item *item) {
  const size_t length = strlen(item->name);
  pags_store_u32(out, 0x04034b50);
  put_shared(out + 4, item);
  memcpy(out + PAGS_ZIP_LOCAL, item->name, length);
  if (item->padding) { /* an extra field of a kind that nobody reads */
    uint8_t *const extra = out + PAGS_ZIP_LOCAL + length;
    memset(extra, 0, item->padding);
    store16(out + 28, item->padding);
    store16(extra, 0x1986); /* the kind that OpenUSD's own archives have */
    store16(extra + 2, item->padding - 4);
  }
  return PAGS_ZIP_LOCAL + length + item->padding;
}

size_t pags_zip_put_central(uint8_t *out, const pags_zip_item *item) {
  const size_t length = strlen(item->name);
  memset(out, 0, PAGS_ZIP_CENTRAL);
  pags_store_u32(out, 0x02014b50);
  store16(out + 4, 20);
  put_shared(out + 6, item);
  pags_store_u32(out + 42, item->offset);
  memcpy(out + PAGS_ZIP_CENTRAL, item->name, length);
  return PAGS_ZIP_CENTRAL + length;
}

size_t pags_zip_put_end(uint8_t *out, int count, size_t directory_offset, size_t directory_size) {
  memset(out, 0, PAGS_ZIP_END);
  pags_store_u32(out, 0x06054b50);
  store16(out + 8, (unsigned)count);
  store16(out + 10, (unsigned)count);
  pags_store_u32(out + 12, (uint32_t)directory_size);
  pags_store_u32(out + 16, (uint32_t)directory_offset);
  return PAGS_ZIP_END;
}

pags_result pags_zip_pack(const char *name, const uint8_t *bytes, size_t size, uint8_t **out, size_t *out_size) {
  const size_t begin = PAGS_ZIP_LOCAL + strlen(name), end = PAGS_ZIP_CENTRAL + strlen(name) + PAGS_ZIP_END;
  pags_zip_item item = {.name = name, .crc = (uint32_t)crc32(0, bytes, (uInt)size), .size = (uint32_t)size};
  z_stream z = {0};
  *out = NULL;
  if (deflateInit2(&z, LEVEL, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    return pags_out_of_memory("'%s', %zu bytes", name, size);
  const size_t most = deflateBound(&z, (uLong)size);
  PAGS_AUTOFREE uint8_t *archive = malloc(begin + most + end);
  z.next_in = (z_const Bytef *)(uintptr_t)bytes, z.avail_in = (uInt)size;
  z.next_out = archive ? archive + begin : NULL, z.avail_out = (uInt)most;
  const bool whole = archive && deflate(&z, Z_FINISH) == Z_STREAM_END;
  deflateEnd(&z);
  PAGS_CHECK_MEMORY(whole, "'%s', %zu bytes", name, size);
  item.packed = (uint32_t)z.total_out;
  pags_zip_put_local(archive, &item);
  uint8_t *const directory = archive + begin + item.packed;
  const size_t length = pags_zip_put_central(directory, &item);
  *out_size = begin + item.packed + length + pags_zip_put_end(directory + length, 1, begin + item.packed, length);
  *out = pags_take(&archive);
  return PAGS_OK;
}
