/* SPDX-License-Identifier: Apache-2.0 */
/* TFRecord files, read one record at a time. A record is
 *
 *   u64 length | u32 masked CRC of these 8 bytes | data | u32 masked CRC of the data        (little-endian)
 *
 * with CRC-32C (Castagnoli: polynomial 0x1edc6f41, reflected, all ones in and out) and mask(c) = rotate right by 15,
 * plus 0xa282ead8. Both are checked, the first before the length is believed; nor is a length believed that the file
 * has no room for, so that a damaged file can't ask for more memory than it holds bytes. Every message names the file,
 * the record's number, from 0, and the offset of its first byte. */
#ifndef PAGS_IMPORT_TFRECORD_H
#define PAGS_IMPORT_TFRECORD_H

#include <pags/base.h>

typedef struct pags_tfrecord pags_tfrecord;

/* Record as handed out: `data` belongs to the reader and is good until its next call. */
typedef struct pags_tfrecord_item {
  const uint8_t *data;
  size_t size;
  int64_t number;  /* from 0 */
  uint64_t offset; /* of the record's length field in the file */
} pags_tfrecord_item;

/* PAGS_ERROR_IO, _MEMORY. An empty file is a file of no records. */
pags_result pags_tfrecord_open(const char *path, pags_tfrecord **out);
void pags_tfrecord_close(pags_tfrecord *reader); /* NULL is allowed */

/* The next record, or data = NULL at the end of the file. PAGS_ERROR_FORMAT where the file is damaged or cut. */
pags_result pags_tfrecord_next(pags_tfrecord *reader, pags_tfrecord_item *item);

/* Passes over a record without reading its data; *end = 1 where there was none. Checks the length and its CRC. */
pags_result pags_tfrecord_skip(pags_tfrecord *reader, int *end);

/* Share of the file's bytes read so far, 0..1. */
double pags_tfrecord_fraction(const pags_tfrecord *reader);

/* CRC-32C of `size` bytes, unmasked. */
uint32_t pags_crc32c(const void *bytes, size_t size);

#endif
