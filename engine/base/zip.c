/* SPDX-License-Identifier: Apache-2.0 */
/* Reads zip archives: the directory at their end, the local headers, deflate by zlib. */
#include "base/zip.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/bytes.h"
#include "base/memory.h"

enum {
  END_RECORD = 22,     /* end of central directory, without its comment */
  CENTRAL_RECORD = 46, /* entry of the central directory, without name, extra field and comment */
  LOCAL_RECORD = 30,   /* local header of a member, without name and extra field */
  MAX_COMMENT = 65535, /* longest comment of an archive, bytes */
  STORED = 0,
  DEFLATED = 8
};

bool pags_zip_is(const uint8_t *bytes, size_t size) {
  return size >= 4 && (memcmp(bytes, "PK\3\4", 4) == 0 || memcmp(bytes, "PK\5\6", 4) == 0);
}

/* Reads the central directory's entry at byte *at, finds and checks the member's data, and moves *at behind the
 * entry. */
static pags_result read_entry(const pags_zip *zip, size_t *at, pags_zip_member *m) {
  if (zip->size - *at < CENTRAL_RECORD || pags_load_u32(zip->bytes + *at) != 0x02014b50)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a directory entry at byte %zu", zip->path, *at);
  const uint8_t *p = zip->bytes + *at;
  m->name_length = pags_load_u16(p + 28);
  size_t length = CENTRAL_RECORD + m->name_length + pags_load_u16(p + 30) + pags_load_u16(p + 32);
  if (zip->size - *at < length)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the directory entry at byte %zu is cut off", zip->path, *at);
  const int name_length = (int)m->name_length, method = pags_load_u16(p + 10);
  m->name = (const char *)p + CENTRAL_RECORD;
  m->crc = pags_load_u32(p + 16);
  m->packed = pags_load_u32(p + 20);
  m->size = pags_load_u32(p + 24);
  m->deflated = method == DEFLATED;
  if (pags_load_u16(p + 8) & 1)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s' is encrypted", zip->path, name_length, m->name);
  if (m->size == UINT32_MAX || m->packed == UINT32_MAX || pags_load_u32(p + 42) == UINT32_MAX)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s' needs zip64", zip->path, name_length, m->name);
  if (method != STORED && method != DEFLATED)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s': expected a stored or deflated member, found method %d",
                     zip->path, name_length, m->name, method);
  if (method == STORED && m->packed != m->size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s' is stored with two sizes, %zu and %zu", zip->path, name_length,
                     m->name, m->packed, m->size);
  *at += length;

  /* The member's data follows its local header, which repeats the name and may have an extra field of another length
   * than that of the central entry. */
  size_t local = pags_load_u32(p + 42);
  if (local > zip->size || zip->size - local < LOCAL_RECORD || pags_load_u32(zip->bytes + local) != 0x04034b50)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': expected a local header at byte %zu", zip->path, name_length,
                     m->name, local);
  size_t skip = (size_t)LOCAL_RECORD + pags_load_u16(zip->bytes + local + 26) + pags_load_u16(zip->bytes + local + 28);
  if (zip->size - local < skip || zip->size - local - skip < m->packed)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': %zu bytes at byte %zu reach beyond the end of the file", zip->path,
                     name_length, m->name, m->packed, local);
  m->offset = local + skip;
  return PAGS_OK;
}

pags_result pags_zip_open(const uint8_t *bytes, size_t size, const char *path, pags_zip *out) {
  PAGS_AUTO(pags_zip_close) pags_zip zip = {.bytes = bytes, .size = size, .path = path};
  *out = (pags_zip){0};
  /* The end record is the last one whose comment ends exactly at the end of the file. */
  size_t end = size < END_RECORD ? 0 : size - END_RECORD + 1;
  bool found = false;
  while (!found && end > 0 && size - end < END_RECORD + MAX_COMMENT) {
    end--;
    found = pags_load_u32(bytes + end) == 0x06054b50 && pags_load_u16(bytes + end + 20) == size - end - END_RECORD;
  }
  if (!found)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a zip archive, found no end record: is it cut off?", path);
  const size_t entries = pags_load_u16(bytes + end + 10);
  size_t at = pags_load_u32(bytes + end + 16);
  if (at > end)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the directory begins beyond the end of the file", path);
  if (entries > (end - at) / CENTRAL_RECORD)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a directory of %zu bytes can't have %zu entries", path, end - at, entries);
  zip.members = calloc(entries + 1, sizeof *zip.members);
  PAGS_CHECK_MEMORY(zip.members, "%s", path);
  for (size_t i = 0, total = 0; i < entries; i++) {
    pags_zip_member *m = &zip.members[i];
    PAGS_TRY(read_entry(&zip, &at, m));
    total += m->packed;
    if (total > size) /* a small file must not ask for more memory than it has bytes */
      return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s' overlaps other members", path, (int)m->name_length, m->name);
    zip.count++;
  }
  *out = zip;
  zip = (pags_zip){0};
  return PAGS_OK;
}

void pags_zip_close(pags_zip *zip) {
  free(zip->members);
  *zip = (pags_zip){0};
}

const pags_zip_member *pags_zip_find(const pags_zip *zip, const char *name) {
  const size_t length = strlen(name);
  for (int64_t i = 0; i < zip->count; i++)
    if (zip->members[i].name_length == length && memcmp(zip->members[i].name, name, length) == 0)
      return &zip->members[i];
  return NULL;
}

/* Inflates a member into a block that is allocated once its size is plausible: deflate packs at most 1032 to 1. */
static pags_result inflate_member(const pags_zip *zip, const pags_zip_member *m, uint8_t *out) {
  z_stream stream = {0};
  if (inflateInit2(&stream, -MAX_WBITS) != Z_OK)
    return pags_out_of_memory("%s", zip->path);
  stream.next_in = (z_const Bytef *)(uintptr_t)(zip->bytes + m->offset);
  stream.avail_in = (uInt)m->packed;
  stream.next_out = out;
  stream.avail_out = (uInt)m->size;
  const int code = inflate(&stream, Z_FINISH);
  const bool whole = code == Z_STREAM_END && stream.total_out == m->size;
  inflateEnd(&stream);
  if (code == Z_MEM_ERROR)
    return pags_out_of_memory("%s", zip->path);
  if (!whole)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': the deflated data are damaged or not of %zu bytes", zip->path,
                     (int)m->name_length, m->name, m->size);
  return PAGS_OK;
}

pags_result pags_zip_read(const pags_zip *zip, const pags_zip_member *m, uint8_t **out) {
  const int name_length = (int)m->name_length;
  *out = NULL;
  if (m->size / 1032 > m->packed)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': %zu bytes can't be packed in %zu", zip->path, name_length, m->name,
                     m->size, m->packed);
  PAGS_AUTOFREE uint8_t *block = malloc(m->size + 1);
  PAGS_CHECK_MEMORY(block, "%s: '%.*s', %zu bytes", zip->path, name_length, m->name, m->size);
  block[m->size] = 0;
  if (m->deflated)
    PAGS_TRY(inflate_member(zip, m, block));
  else
    memcpy(block, zip->bytes + m->offset, m->size);
  if (crc32(0, block, (uInt)m->size) != m->crc)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': wrong CRC", zip->path, name_length, m->name);
  *out = pags_take(&block);
  return PAGS_OK;
}
