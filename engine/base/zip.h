/* SPDX-License-Identifier: Apache-2.0 */
/* Zip archives (APPNOTE 6.3.x, 4.3): a reader of those in memory, with stored and deflated members, without encryption
 * and zip64, which checks every offset and size against the archive and every member against its CRC; and the records
 * of archives that are written. */
#ifndef PAGS_BASE_ZIP_H
#define PAGS_BASE_ZIP_H

#include <stdbool.h>

#include <pags/base.h>

typedef struct pags_zip_member {
  const char *name; /* not null-terminated; inside of the archive */
  size_t name_length;
  size_t offset, packed; /* of its data in the archive, bytes */
  size_t size;           /* of its contents, bytes */
  uint32_t crc;
  bool deflated;
} pags_zip_member;

typedef struct pags_zip {
  const uint8_t *bytes; /* the archive, owned by the caller */
  size_t size;
  const char *path; /* named in messages */
  int64_t count;
  pags_zip_member *members; /* in the order of the directory; no two share data */
} pags_zip;

/* Whether the bytes begin as a zip archive does. */
bool pags_zip_is(const uint8_t *bytes, size_t size);

/* Reads the directory. `bytes` and `path` must outlive the archive. PAGS_ERROR_FORMAT, _UNSUPPORTED (encrypted, zip64,
 * other compression) or _MEMORY; then `out` is empty. */
pags_result pags_zip_open(const uint8_t *bytes, size_t size, const char *path, pags_zip *out);
void pags_zip_close(pags_zip *zip); /* frees and zeroes; a zeroed archive is allowed */

/* Returns the member of that name, or NULL. */
const pags_zip_member *pags_zip_find(const pags_zip *zip, const char *name);

/* Returns the contents of a member with a zero byte after the end: *out, of member->size bytes, is freed by the caller.
 * PAGS_ERROR_FORMAT (damaged, wrong size or CRC) or PAGS_ERROR_MEMORY; then *out is NULL. */
pags_result pags_zip_read(const pags_zip *zip, const pags_zip_member *member, uint8_t **out);

/* ---- Writing ---- */

enum { PAGS_ZIP_LOCAL = 30, PAGS_ZIP_CENTRAL = 46, PAGS_ZIP_END = 22 }; /* bytes without names and padding */

typedef struct pags_zip_item {
  const char *name;
  uint32_t crc, size; /* of its contents */
  uint32_t packed;    /* bytes of its data if they are deflated; 0: stored */
  uint32_t offset;    /* of its local record */
  uint32_t padding;   /* bytes between its name and its data: 0, or at least 4 */
} pags_zip_item;

/* Write a member's local record (`out`: PAGS_ZIP_LOCAL, its name and its padding), its entry in the directory
 * (PAGS_ZIP_CENTRAL and its name) and the record that ends the archive. Return how many bytes they wrote. The time is
 * always the first that zip knows, so that the same contents are the same bytes. */
size_t pags_zip_put_local(uint8_t *out, const pags_zip_item *item);
size_t pags_zip_put_central(uint8_t *out, const pags_zip_item *item);
size_t pags_zip_put_end(uint8_t *out, int count, size_t directory_offset, size_t directory_size);

/* Makes an archive of one deflated member of 1 to 2^32 - 1 bytes: *out, of *out_size bytes, is freed by the caller.
 * PAGS_ERROR_MEMORY; then *out is NULL. */
pags_result pags_zip_pack(const char *name, const uint8_t *bytes, size_t size, uint8_t **out, size_t *out_size);

#endif
