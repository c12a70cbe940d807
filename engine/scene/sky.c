/* SPDX-License-Identifier: Apache-2.0 */
/* The cube map of the sky (pags/sky.h): allocation, reading and writing of sky.npy (NumPy's format, NEP 1, float16),
 * and the bilinear lookup of the colour in a direction. */
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

enum { FACES = 6, CHANNELS = 3, MAX_SIZE = 4096, PREFIX = 10, HEADER = 128, MAX_HEADER = 4096, BLOCK = 4096 };

static const char magic[] = "\x93NUMPY";

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

pags_result pags_sky_load(const char *path, pags_sky *sky) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  *sky = (pags_sky){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_result result = decode(path, bytes, size, sky);
  if (result != PAGS_OK)
    pags_sky_destroy(sky);
  return result;
}

uint64_t pags_sky_file_size(const pags_sky *sky) {
  return HEADER + 2 * (uint64_t)value_count(sky->size);
}

pags_result pags_sky_save(const char *path, const pags_sky *sky) {
  assert(sky->size > 0 && sky->texels);
  pags_file_writer writer;
  PAGS_TRY(pags_file_writer_begin(&writer, path));

  /* The npy header (version 1) as NumPy writes it: padded with blanks so that the values begin at a multiple of 64
   * bytes, the last character a line break. */
  char text[96];
  snprintf(text, sizeof text, "{'descr': '<f2', 'fortran_order': False, 'shape': (6, %d, %d, 3), }", sky->size,
           sky->size);
  uint8_t header[HEADER + 1] = {[6] = 1, [8] = HEADER - PREFIX};
  memcpy(header, magic, 6);
  snprintf((char *)header + PREFIX, sizeof header - PREFIX, "%-*s\n", HEADER - PREFIX - 1, text);
  PAGS_TRY(pags_file_writer_put(&writer, header, HEADER));

  /* The texels as little-endian float16, in blocks; a value that float16 cannot hold is an error. */
  uint8_t block[2 * BLOCK];
  const size_t count = value_count(sky->size);
  for (size_t first = 0; first < count; first += BLOCK) {
    const size_t n = count - first < BLOCK ? count - first : BLOCK;
    for (size_t i = 0; i < n; i++) {
      const uint16_t half = pags_half_from_float(sky->texels[first + i]);
      if ((half & 0x7C00) == 0x7C00) {
        pags_file_writer_abort(&writer);
        return pags_fail(PAGS_ERROR_ARGUMENT, "%s: the sky's texel %zu is %g, which float16 can't hold", path,
                         (first + i) / CHANNELS, (double)sky->texels[first + i]);
      }
      block[2 * i] = (uint8_t)half;
      block[2 * i + 1] = (uint8_t)(half >> 8);
    }
    PAGS_TRY(pags_file_writer_put(&writer, block, 2 * n));
  }
  return pags_file_writer_commit(&writer);
}

/* Returns the face (0..5) of the cube that direction r meets, and the texture coordinates (0..1) of that point. */
static int find_face(const double r[3], double *s, double *t) {
  double x = fabs(r[0]), y = fabs(r[1]), z = fabs(r[2]);
  int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  double sign = r[axis] < 0 ? -1 : 1, major = fabs(r[axis]);
  double sc = axis == 0 ? -sign * r[2] : axis == 1 ? r[0] : sign * r[0];
  double tc = axis == 1 ? sign * r[2] : -r[1];
  *s = 0.5 * (sc / major + 1);
  *t = 0.5 * (tc / major + 1);
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
  double s, t;
  int columns[2], rows[2];
  assert(sky->size > 0);
  int face = find_face(direction, &s, &t);
  double right = neighbours(s, sky->size, columns), below = neighbours(t, sky->size, rows);
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
