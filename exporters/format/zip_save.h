/* SPDX-License-Identifier: Apache-2.0 */
/* The records of a zip archive of stored members (APPNOTE 6.3.x), for .sog and .usdz. */
#ifndef PAGS_FORMAT_ZIP_SAVE_H
#define PAGS_FORMAT_ZIP_SAVE_H

#include <stddef.h>
#include <stdint.h>

enum { PAGS_ZIP_LOCAL = 30, PAGS_ZIP_CENTRAL = 46, PAGS_ZIP_END = 22 }; /* bytes without names and padding */

typedef struct pags_zip_item {
  const char *name;
  uint32_t crc, size;
  uint32_t offset;  /* of its local record */
  uint32_t padding; /* bytes between its name and its data: 0, or at least 4 */
} pags_zip_item;

/* Write a member's local record (`out`: PAGS_ZIP_LOCAL, its name and its padding), its entry in the directory
 * (PAGS_ZIP_CENTRAL and its name) and the record that ends the archive. Return how many bytes they wrote. */
size_t pags_zip_put_local(uint8_t *out, const pags_zip_item *item);
size_t pags_zip_put_central(uint8_t *out, const pags_zip_item *item);
size_t pags_zip_put_end(uint8_t *out, int count, size_t directory_offset, size_t directory_size);

#endif
