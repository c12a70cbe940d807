/* SPDX-License-Identifier: Apache-2.0 */
/* Parses .npz files: the zip container (APPNOTE 6.3.x, 4.3) and the header of .npy arrays (NumPy NEP 1). */
#include "eval/npz.h"

#include "base/file.h"
#include "base/memory.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

enum {
  END_RECORD = 22,     /* end of central directory, without its comment */
  CENTRAL_RECORD = 46, /* entry of the central directory, without name, extra field and comment */
  LOCAL_RECORD = 30,   /* local header of a member, without name and extra field */
  MAX_COMMENT = 65535  /* longest comment of an archive, bytes */
};

/* The file in memory; `path` is for error messages. */
typedef struct archive {
  const uint8_t *bytes;
  size_t size;
  const char *path;
} archive;

typedef struct member {
  const char *name; /* not null-terminated */
  size_t name_length;
  size_t offset, size; /* of the stored data */
  uint32_t crc;
} member;

/* ---- The zip container ---- */

static uint32_t get16(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}
static uint32_t get32(const uint8_t *p) {
  return get16(p) | get16(p + 2) << 16;
}

/* Finds the end-of-central-directory record: the last one whose comment ends exactly at the end of the file. */
static pags_result find_end(const archive *zip, size_t *end) {
  if (zip->size >= END_RECORD) {
    size_t first = zip->size > END_RECORD + MAX_COMMENT ? zip->size - END_RECORD - MAX_COMMENT : 0;
    for (size_t at = zip->size - END_RECORD + 1; at-- > first;) {
      const uint8_t *p = zip->bytes + at;
      if (get32(p) == 0x06054b50 && get16(p + 20) == zip->size - at - END_RECORD) {
        *end = at;
        return PAGS_OK;
      }
    }
  }
  return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a zip archive, found no end record", zip->path);
}

/* Reads the central directory's entry at byte *at, finds and checks the member's data, and moves *at behind the
 * entry. */
static pags_result read_entry(const archive *zip, size_t *at, member *m) {
  if (zip->size - *at < CENTRAL_RECORD || get32(zip->bytes + *at) != 0x02014b50)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a directory entry at byte %zu", zip->path, *at);
  const uint8_t *p = zip->bytes + *at;
  m->name_length = get16(p + 28);
  size_t length = CENTRAL_RECORD + m->name_length + get16(p + 30) + get16(p + 32);
  if (zip->size - *at < length)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the directory entry at byte %zu is cut off", zip->path, *at);
  m->name = (const char *)p + CENTRAL_RECORD;
  m->crc = get32(p + 16);
  m->size = get32(p + 24);
  if (get16(p + 10) != 0 || (get16(p + 8) & 1) || get32(p + 20) != m->size)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s' is compressed or encrypted, expected a stored member",
                     zip->path, (int)m->name_length, m->name);
  if (m->size == UINT32_MAX || get32(p + 42) == UINT32_MAX)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s' needs zip64", zip->path, (int)m->name_length, m->name);
  *at += length;

  /* The member's data follows its local header, which repeats the name and may have an extra field of another length
   * than that of the central entry. */
  size_t local = get32(p + 42);
  if (local > zip->size || zip->size - local < LOCAL_RECORD || get32(zip->bytes + local) != 0x04034b50)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': expected a local header at byte %zu", zip->path,
                     (int)m->name_length, m->name, local);
  size_t skip = (size_t)LOCAL_RECORD + get16(zip->bytes + local + 26) + get16(zip->bytes + local + 28);
  if (zip->size - local < skip || zip->size - local - skip < m->size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': %zu bytes at byte %zu reach beyond the end of the file", zip->path,
                     (int)m->name_length, m->name, m->size, local);
  m->offset = local + skip;
  if (crc32(0, zip->bytes + m->offset, (uInt)m->size) != m->crc)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s': wrong CRC", zip->path, (int)m->name_length, m->name);
  return PAGS_OK;
}

/* ---- The header and the values of an array ---- */

/* Returns the position of a key's value in the header's dictionary, behind the key and blanks; NULL if the key is
 * missing. `key` includes quotes and colon. */
static const char *find_key(const char *header, const char *key) {
  const char *p = strstr(header, key);
  if (!p)
    return NULL;
  p += strlen(key);
  return p + strspn(p, " ");
}

static bool parse_shape(const char *p, pags_npz_array *array) {
  if (*p++ != '(')
    return false;
  array->rank = 0;
  array->count = 1;
  for (;;) {
    p += strspn(p, " ,");
    if (*p == ')')
      return true;
    if (*p < '0' || *p > '9' || array->rank == PAGS_NPZ_MAX_RANK)
      return false;
    int64_t extent = 0;
    for (; *p >= '0' && *p <= '9'; p++) {
      extent = extent * 10 + (*p - '0');
      if (extent > INT32_MAX)
        return false;
    }
    array->shape[array->rank++] = extent;
    if (extent != 0 && array->count > INT32_MAX / extent)
      return false;
    array->count *= extent;
  }
}

/* Reads the shape from an .npy header and checks the element type and order. `text` is the header's dictionary,
 * null-terminated. */
static pags_result parse_header(const char *text, const char *path, pags_npz_array *array) {
  const char *descr = find_key(text, "'descr':"), *order = find_key(text, "'fortran_order':");
  const char *shape = find_key(text, "'shape':");
  if (!descr || !order || !shape || !parse_shape(shape, array))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%s': expected an npy header with descr, fortran_order and shape", path,
                     array->name);
  if (strncmp(descr, "'<f4'", 5) != 0 || strncmp(order, "False", 5) != 0)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%s': expected little-endian float32 in C order", path, array->name);
  return PAGS_OK;
}

static void copy_floats(float *out, const uint8_t *bytes, int64_t count) {
  for (int64_t i = 0; i < count; i++) {
    uint32_t bits = get32(bytes + 4 * i);
    memcpy(out + i, &bits, sizeof bits);
  }
}

static pags_result parse_npy(const uint8_t *bytes, size_t size, const char *path, pags_npz_array *array) {
  if (size < 12 || memcmp(bytes, "\x93NUMPY", 6) != 0 || bytes[6] < 1 || bytes[6] > 3)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%s': expected an npy array of version 1 to 3", path, array->name);
  size_t begin = bytes[6] == 1 ? 10 : 12;
  size_t length = bytes[6] == 1 ? get16(bytes + 8) : get32(bytes + 8);
  if (size - begin < length)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%s': the npy header is cut off", path, array->name);
  char *text = malloc(length + 1);
  if (!text)
    return pags_out_of_memory("%s", path);
  memcpy(text, bytes + begin, length);
  text[length] = '\0';
  pags_result result = parse_header(text, path, array);
  free(text);
  PAGS_TRY(result);
  if ((size - begin - length) != (uint64_t)array->count * 4)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: '%s': expected %lld bytes of values, found %zu", path, array->name,
                     (long long)array->count * 4, size - begin - length);
  array->data = malloc(array->count ? (size_t)array->count * sizeof(float) : 1);
  if (!array->data)
    return pags_out_of_memory("%s", path);
  copy_floats(array->data, bytes + begin + length, array->count);
  return PAGS_OK;
}

/* ---- All members of an archive ---- */

static pags_result read_members(const archive *zip, pags_npz *out) {
  size_t end = 0;
  PAGS_TRY(find_end(zip, &end));
  size_t entries = get16(zip->bytes + end + 10), at = get32(zip->bytes + end + 16);
  if (at > end)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the directory begins beyond the end of the file", zip->path);
  if (entries > (end - at) / CENTRAL_RECORD)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a directory of %zu bytes can't have %zu entries", zip->path, end - at,
                     entries);
  out->arrays = calloc(entries ? entries : 1, sizeof *out->arrays);
  if (!out->arrays)
    return pags_out_of_memory("%s", zip->path);
  for (size_t i = 0, total = 0; i < entries; i++) {
    member m = {0};
    PAGS_TRY(read_entry(zip, &at, &m));
    total += m.size;
    if (total > zip->size) /* a small file must not ask for more memory than it has bytes */
      return pags_fail(PAGS_ERROR_FORMAT, "%s: '%.*s' overlaps other members", zip->path, (int)m.name_length, m.name);
    out->count++; /* counted first, so that a member that fails half-way is freed */
    /* The array's name is the member's without ".npy". */
    size_t length = m.name_length;
    if (length > 4 && memcmp(m.name + length - 4, ".npy", 4) == 0)
      length -= 4;
    out->arrays[i].name = malloc(length + 1);
    if (!out->arrays[i].name)
      return pags_out_of_memory("%s", zip->path);
    memcpy(out->arrays[i].name, m.name, length);
    out->arrays[i].name[length] = '\0';
    PAGS_TRY(parse_npy(zip->bytes + m.offset, m.size, zip->path, &out->arrays[i]));
  }
  return PAGS_OK;
}

pags_result pags_npz_parse(const uint8_t *bytes, size_t size, const char *path, pags_npz *out) {
  archive zip = {.bytes = bytes, .size = size, .path = path};
  *out = (pags_npz){0};
  pags_result result = read_members(&zip, out);
  if (result != PAGS_OK)
    pags_npz_destroy(out);
  return result;
}

void pags_npz_destroy(pags_npz *npz) {
  for (int64_t i = 0; i < npz->count; i++) {
    free(npz->arrays[i].name);
    free(npz->arrays[i].data);
  }
  free(npz->arrays);
  *npz = (pags_npz){0};
}

pags_result pags_npz_load(const char *path, pags_npz *out) {
  uint8_t *bytes = NULL;
  size_t size = 0;
  *out = (pags_npz){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  pags_result result = pags_npz_parse(bytes, size, path, out);
  free(bytes);
  return result;
}

const pags_npz_array *pags_npz_find(const pags_npz *npz, const char *name) {
  for (int64_t i = 0; i < npz->count; i++)
    if (strcmp(npz->arrays[i].name, name) == 0)
      return &npz->arrays[i];
  return NULL;
}
