/* SPDX-License-Identifier: Apache-2.0 */
/* The cube map of the sky (pags/sky.h): allocation, reading and writing of sky.npz (NumPy's format, NEP 1, float16, in
 * a zip archive), and the bilinear lookup of the colour in a direction. */
#include <pags/sky.h>

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/half.h"
#include "base/memory.h"
#include "base/zip.h"

enum { FACES = 6, CHANNELS = 3, MAX_SIZE = 4096, PREFIX = 10, HEADER = 128, MAX_HEADER = 4096 };

static const char magic[] = "\x93NUMPY", member[] = "sky.npy";

static size_t value_count(int size) {
  return (size_t)FACES * CHANNELS * (size_t)size * (size_t)size;
}

pags_result pags_sky_create(pags_sky *sky, int size) {
  assert(size >= 0 && size <= MAX_SIZE);
  *sky = (pags_sky){0};
  if (size == 0)
    return PAGS_OK;
  sky->texels = calloc(value_count(size), sizeof *sky->texels);
  PAGS_CHECK_MEMORY(sky->texels, "a sky of %d texels a side (%.1f MB)", size, (double)value_count(size) * 4e-6);
  sky->size = size;
  return PAGS_OK;
}

void pags_sky_destroy(pags_sky *sky) {
  free(sky->texels);
  *sky = (pags_sky){0};
}

/* Finds a key, with its quotes and colon, in the text of a Python dictionary and returns what follows it, blanks
 * skipped; NULL: no such key. */
static const char *find_entry(const char *header, const char *key) {
  const char *at = strstr(header, key);
  return at ? at + strlen(key) + strspn(at + strlen(key), " ") : NULL;
}

/* Parses the npy header, the text of a Python dictionary of `length` bytes: *size is the number N of texels a side of
 * a float16 array of shape (6, N, N, 3). */
static pags_result read_header(const char *path, const uint8_t *bytes, size_t length, int *size) {
  char header[MAX_HEADER];
  if (length >= sizeof header)
    return pags_fail_at(path, "expected a header of less than %d bytes, found %zu", MAX_HEADER, length);
  memcpy(header, bytes, length);
  header[length] = 0;
  const char *type = find_entry(header, "'descr':"), *order = find_entry(header, "'fortran_order':");
  const char *shape = find_entry(header, "'shape':");
  if (!type || !order || !shape)
    return pags_fail_at(path, "expected 'descr', 'fortran_order' and 'shape' in the npy header");
  if (strncmp(type, "'<f2'", 5) != 0 || strncmp(order, "False", 5) != 0)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: expected little-endian float16 ('<f2') in C order, found %.8s", path,
                     type);

  int faces, rows, columns, channels;
  if (sscanf(shape, "(%4d , %5d , %5d , %4d", &faces, &rows, &columns, &channels) != 4 || faces != FACES ||
      channels != CHANNELS || rows != columns || rows < 1 || rows > MAX_SIZE)
    return pags_fail_at(path, "expected a 'shape' of (6, N, N, 3), N from 1 to %d, found %.*s", MAX_SIZE,
                        (int)strcspn(shape, ")\n") + (strchr(shape, ')') != NULL), shape);
  *size = rows;
  return PAGS_OK;
}

/* Decodes the contents of an npy file of versions 1 to 3. */
static pags_result decode(const char *path, const uint8_t *bytes, size_t size, pags_sky *sky) {
  int texels;
  if (size < PREFIX + 2 || memcmp(bytes, magic, 6) != 0 || bytes[6] < 1 || bytes[6] > 3)
    return pags_fail_at(path, "expected an npy array of version 1 to 3");
  size_t begin = bytes[6] == 1 ? PREFIX : PREFIX + 2;
  size_t length = bytes[6] == 1 ? pags_load_u16(bytes + 8) : pags_load_u32(bytes + 8);
  if (size - begin < length)
    return pags_fail_at(path, "the npy header is cut off");
  PAGS_TRY(read_header(path, bytes + begin, length, &texels));
  begin += length;
  if (size - begin != 2 * value_count(texels))
    return pags_fail_at(path, "expected %zu bytes of texels from byte %zu, found %zu", 2 * value_count(texels), begin,
                        size - begin);
  PAGS_TRY(pags_sky_create(sky, texels));
  float least = 0.0f, most = 0.0f;
  for (size_t i = 0; i < value_count(texels); i++) {
    sky->texels[i] = pags_float_from_half(pags_load_u16(bytes + begin + 2 * i));
    if (!isfinite(sky->texels[i]))
      return pags_fail_at(path, "expected finite numbers, found %s at byte %zu", isnan(sky->texels[i]) ? "nan" : "inf",
                          begin + 2 * i);
    least = sky->texels[i] < least ? sky->texels[i] : least;
    most = sky->texels[i] > most ? sky->texels[i] : most;
  }
  sky->dip = least < 0.0f ? fminf(-least / most, 1.0f) : 0.0f;
  return PAGS_OK;
}

/* Decodes the array of an npz file. */
static pags_result decode_archive(const char *path, const uint8_t *bytes, size_t size, pags_sky *sky) {
  PAGS_AUTO(pags_zip_close) pags_zip zip = {0};
  PAGS_AUTOFREE uint8_t *array = NULL;
  PAGS_TRY(pags_zip_open(bytes, size, path, &zip));
  const pags_zip_member *const found = pags_zip_find(&zip, member);
  if (!found)
    return pags_fail_at(path, "expected an npz archive with a member '%s'", member);
  PAGS_TRY(pags_zip_read(&zip, found, &array));
  return decode(path, array, found->size, sky);
}

pags_result pags_sky_load(const char *path, pags_sky *sky) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  *sky = (pags_sky){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_result result =
      pags_zip_is(bytes, size) ? decode_archive(path, bytes, size, sky) : decode(path, bytes, size, sky);
  if (result != PAGS_OK)
    pags_sky_destroy(sky);
  return result;
}

/* Makes the contents of an npy file: *out, of *size bytes, is freed by the caller. */
static pags_result encode(const char *path, const pags_sky *sky, uint8_t **out, size_t *size) {
  const size_t count = value_count(sky->size);
  PAGS_AUTOFREE uint8_t *bytes = calloc(HEADER + 2 * count, 1);
  PAGS_CHECK_MEMORY(bytes, "%s: a sky of %d texels a side", path, sky->size);

  /* The npy header (version 1) as NumPy writes it: padded with blanks so that the values begin at a multiple of 64
   * bytes, the last character a line break. */
  char text[96], line[HEADER - PREFIX + 1];
  snprintf(text, sizeof text, "{'descr': '<f2', 'fortran_order': False, 'shape': (6, %d, %d, 3), }", sky->size,
           sky->size);
  snprintf(line, sizeof line, "%-*s\n", HEADER - PREFIX - 1, text);
  memcpy(bytes, magic, 6);
  bytes[6] = 1;
  bytes[8] = HEADER - PREFIX;
  memcpy(bytes + PREFIX, line, HEADER - PREFIX);

  /* The texels as little-endian float16; a value that float16 cannot hold is an error. */
  for (size_t i = 0; i < count; i++) {
    const uint16_t half = pags_half_from_float(sky->texels[i]);
    if ((half & 0x7C00) == 0x7C00)
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: the sky's texel %zu is %g, which float16 can't hold", path,
                       i / CHANNELS, (double)sky->texels[i]);
    bytes[HEADER + 2 * i] = (uint8_t)half;
    bytes[HEADER + 2 * i + 1] = (uint8_t)(half >> 8);
  }
  *out = pags_take(&bytes);
  *size = HEADER + 2 * count;
  return PAGS_OK;
}

static pags_result pack(const char *path, const pags_sky *sky, uint8_t **out, size_t *size) {
  PAGS_AUTOFREE uint8_t *array = NULL;
  size_t length;
  *out = NULL;
  PAGS_TRY(encode(path, sky, &array, &length));
  return pags_zip_pack(member, array, length, out, size);
}

pags_result pags_sky_file_size(const pags_sky *sky, uint64_t *bytes) {
  PAGS_AUTOFREE uint8_t *packed = NULL;
  size_t size = 0;
  PAGS_TRY(sky->size > 0 ? pack("sky", sky, &packed, &size) : PAGS_OK);
  *bytes = size;
  return PAGS_OK;
}

pags_result pags_sky_save(const char *path, const pags_sky *sky) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  assert(sky->size > 0 && sky->texels);
  const bool plain = !strcmp(pags_path_extension(path), ".npy");
  PAGS_TRY(plain ? encode(path, sky, &bytes, &size) : pack(path, sky, &bytes, &size));
  return pags_file_write(path, bytes, size);
}

int pags_sky_face(const double r[3], double at[2]) {
  double x = fabs(r[0]), y = fabs(r[1]), z = fabs(r[2]);
  int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  double sign = r[axis] < 0 ? -1 : 1, major = fabs(r[axis]);
  double sc = axis == 0 ? -sign * r[2] : axis == 1 ? r[0] : sign * r[0];
  double tc = axis == 1 ? sign * r[2] : -r[1];
  at[0] = 0.5 * (sc / major + 1);
  at[1] = 0.5 * (tc / major + 1);
  return 2 * axis + (sign < 0);
}

/* Finds the two texels on either side of a texture coordinate (0..1), clamped at the border of the face. Returns the
 * weight (0..1) of the second one in linear interpolation. */
static double neighbours(double coordinate, int size, int index[2]) {
  double at = fmin(fmax(coordinate * size - 0.5, 0), size - 1.0);
  index[0] = (int)at;
  index[1] = index[0] + 1 < size ? index[0] + 1 : index[0];
  return at - index[0];
}

void pags_sky_sample(const pags_sky *sky, const double direction[3], float rgb[3]) {
  double at[2];
  int columns[2], rows[2];
  assert(sky->size > 0);
  int face = pags_sky_face(direction, at);
  double right = neighbours(at[0], sky->size, columns), below = neighbours(at[1], sky->size, rows);
  const float *texels = sky->texels + (size_t)face * CHANNELS * (size_t)sky->size * (size_t)sky->size;
  for (int c = 0; c < CHANNELS; c++) {
    double value[2];
    for (int i = 0; i < 2; i++) {
      const float *row = texels + (size_t)CHANNELS * (size_t)rows[i] * (size_t)sky->size + c;
      value[i] = (1 - right) * (double)row[CHANNELS * columns[0]] + right * (double)row[CHANNELS * columns[1]];
    }
    rgb[c] = (float)((1 - below) * value[0] + below * value[1]);
  }
}
