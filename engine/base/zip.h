/* SPDX-License-Identifier: Apache-2.0 */
/* Reader of zip archives (APPNOTE 6.3.x, 4.3) that are in memory: stored and deflated members, without encryption and
 * zip64. Every offset and size is checked against the archive, every member against its CRC. */
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

#endif
