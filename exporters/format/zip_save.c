/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the records of zip archives. The time is always the first that zip knows, so that the same contents are the
 * same bytes. */
#include <string.h>

#include "base/bytes.h"
#include "exporters/format/splat_save.h"

static void store16(uint8_t *p, unsigned value) {
  p[0] = (uint8_t)value;
  p[1] = (uint8_t)(value >> 8);
}

/* What both records of a member share: 26 bytes from the version that is needed on. */
static void put_shared(uint8_t *p, const pags_zip_item *item) {
  memset(p, 0, 26);
  store16(p, 20);
  store16(p + 8, 0x21); /* 1980-01-01 */
  pags_store_u32(p + 10, item->crc);
  pags_store_u32(p + 14, item->size);
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
