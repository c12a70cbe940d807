/* SPDX-License-Identifier: Apache-2.0 */
/* Reads TFRecord files one record at a time. A record is
 *
 *   u64 length | u32 masked CRC of these 8 bytes | data | u32 masked CRC of the data        (little-endian)
 *
 * with CRC-32C (Castagnoli: polynomial 0x1edc6f41, reflected, all ones in and out) and mask(c) = rotate right by 15,
 * plus 0xa282ead8. Both CRCs are checked, the first before the length is used. A length that exceeds the rest of the
 * file is an error, so that a damaged file can't cause an allocation larger than the file. Every error message names
 * the file, the number of the record, from 0, and the offset of its first byte. */
#ifndef PAGS_IMPORT_TFRECORD_H
#define PAGS_IMPORT_TFRECORD_H

#include <pags/base.h>

#include "base/memory.h"

typedef struct pags_tfrecord pags_tfrecord;

/* A record; `data` belongs to the reader and is valid until the next call of the reader. */
typedef struct pags_tfrecord_item {
  const uint8_t *data;
  size_t size;
  int64_t number;  /* from 0 */
  uint64_t offset; /* offset of the record's first byte (its length field) in the file */
} pags_tfrecord_item;

/* Opens a file; fails with PAGS_ERROR_IO or PAGS_ERROR_MEMORY. An empty file has no records and is valid. */
pags_result pags_tfrecord_open(const char *path, pags_tfrecord **out);
void pags_tfrecord_close(pags_tfrecord *reader); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_tfrecord, pags_tfrecord_close)

/* Reads the next record; item->data is NULL at the end of the file. PAGS_ERROR_FORMAT if the file is damaged or
 * truncated. */
pags_result pags_tfrecord_next(pags_tfrecord *reader, pags_tfrecord_item *item);

/* Skips a record without reading its data, but checks its length and the CRC of the length; *end = 1 at the end of
 * the file. */
pags_result pags_tfrecord_skip(pags_tfrecord *reader, int *end);

/* Returns the fraction of the file's bytes read until now, 0..1. */
double pags_tfrecord_fraction(const pags_tfrecord *reader);

#endif
