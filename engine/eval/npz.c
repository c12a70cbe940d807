/* SPDX-License-Identifier: Apache-2.0 */
/* Parses .npz files: the header of .npy arrays (NumPy NEP 1) in the members of a zip archive. */
#include "eval/npz.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/zip.h"

/* ---- The header and the values of an array ---- */

/* Returns the position of a key's value in the header's dictionary, behind the key and blanks; NULL if the key is
 * missing. `key` includes quotes and colon. */
static const char *find_key(const char *header, const char *key) {
  const char *p = strstr(header, key);
  return p ? p + strlen(key) + strspn(p + strlen(key), " ") : NULL;
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

static pags_result parse_npy(const uint8_t *bytes, size_t size, const char *path, pags_npz_array *array) {
  if (size < 12 || memcmp(bytes, "\x93NUMPY", 6) != 0 || bytes[6] < 1 || bytes[6] > 3)
    return pags_fail_at(path, "'%s': expected an npy array of version 1 to 3", array->name);
  size_t begin = bytes[6] == 1 ? 10 : 12;
  size_t length = bytes[6] == 1 ? pags_load_u16(bytes + 8) : pags_load_u32(bytes + 8);
  if (size - begin < length)
    return pags_fail_at(path, "'%s': the npy header is cut off", array->name);
  PAGS_AUTOFREE char *text = malloc(length + 1);
  PAGS_CHECK_MEMORY(text, "%s", path);
  memcpy(text, bytes + begin, length);
  text[length] = '\0';
  const char *descr = find_key(text, "'descr':"), *order = find_key(text, "'fortran_order':");
  const char *shape = find_key(text, "'shape':");
  if (!descr || !order || !shape || !parse_shape(shape, array))
    return pags_fail_at(path, "'%s': expected an npy header with descr, fortran_order and shape", array->name);
  if (strncmp(descr, "'<f4'", 5) != 0 || strncmp(order, "False", 5) != 0)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%s': expected little-endian float32 in C order", path, array->name);
  if ((size - begin - length) != (uint64_t)array->count * 4)
    return pags_fail_at(path, "'%s': expected %lld bytes of values, found %zu", array->name,
                        (long long)array->count * 4, size - begin - length);
  array->data = malloc(array->count ? (size_t)array->count * sizeof(float) : 1);
  PAGS_CHECK_MEMORY(array->data, "%s", path);
  for (int64_t i = 0; i < array->count; i++)
    array->data[i] = pags_load_f32(bytes + begin + length + 4 * i);
  return PAGS_OK;
}

/* ---- All members of an archive ---- */

static pags_result read_members(const pags_zip *zip, pags_npz *out) {
  out->arrays = calloc((size_t)zip->count + 1, sizeof *out->arrays);
  PAGS_CHECK_MEMORY(out->arrays, "%s", zip->path);
  for (int64_t i = 0; i < zip->count; i++) {
    const pags_zip_member *m = &zip->members[i];
    PAGS_AUTOFREE uint8_t *bytes = NULL;
    out->count++; /* counted first, so that a member that fails half-way is freed */
    /* The array's name is the member's without ".npy". */
    size_t length = m->name_length;
    if (length > 4 && memcmp(m->name + length - 4, ".npy", 4) == 0)
      length -= 4;
    out->arrays[i].name = malloc(length + 1);
    PAGS_CHECK_MEMORY(out->arrays[i].name, "%s", zip->path);
    memcpy(out->arrays[i].name, m->name, length);
    out->arrays[i].name[length] = '\0';
    if (m->deflated) /* so that a small file can't ask for much memory */
      return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%.*s' is compressed, expected a stored member", zip->path,
                       (int)m->name_length, m->name);
    PAGS_TRY(pags_zip_read(zip, m, &bytes));
    PAGS_TRY(parse_npy(bytes, m->size, zip->path, &out->arrays[i]));
  }
  return PAGS_OK;
}

pags_result pags_npz_parse(const uint8_t *bytes, size_t size, const char *path, pags_npz *out) {
  PAGS_AUTO(pags_zip_close) pags_zip zip = {0};
  *out = (pags_npz){0};
  PAGS_TRY(pags_zip_open(bytes, size, path, &zip));
  const pags_result result = read_members(&zip, out);
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
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  *out = (pags_npz){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return pags_npz_parse(bytes, size, path, out);
}

const pags_npz_array *pags_npz_find(const pags_npz *npz, const char *name) {
  for (int64_t i = 0; i < npz->count; i++)
    if (strcmp(npz->arrays[i].name, name) == 0)
      return &npz->arrays[i];
  return NULL;
}
