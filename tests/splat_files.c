/* SPDX-License-Identifier: Apache-2.0 */
/* Makes small splat files; see splat_files.h. */
#include "splat_files.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include <zstd.h>

#include "base/rng.h"

void bytes_put(file_bytes *bytes, const void *data, size_t size) {
  if (bytes->size + size > bytes->capacity) {
    bytes->capacity = 2 * (bytes->size + size) + 256;
    bytes->data = realloc(bytes->data, bytes->capacity);
    if (!bytes->data)
      abort();
  }
  if (size)
    memcpy(bytes->data + bytes->size, data, size);
  bytes->size += size;
}

void bytes_text(file_bytes *bytes, const char *format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  int length = vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  bytes_put(bytes, text, (size_t)length);
}

void bytes_u8(file_bytes *bytes, unsigned value) {
  uint8_t byte = (uint8_t)value;
  bytes_put(bytes, &byte, 1);
}

void bytes_u32(file_bytes *bytes, uint32_t value) {
  for (int i = 0; i < 4; i++)
    bytes_u8(bytes, value >> (8 * i) & 255);
}

void bytes_u64(file_bytes *bytes, uint64_t value) {
  bytes_u32(bytes, (uint32_t)value);
  bytes_u32(bytes, (uint32_t)(value >> 32));
}

void bytes_f32(file_bytes *bytes, float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  bytes_u32(bytes, bits);
}

void bytes_free(file_bytes *bytes) {
  free(bytes->data);
  *bytes = (file_bytes){0};
}

void sample_gaussians(pags_gaussians *g, int64_t count, int sh_degree, uint64_t seed) {
  if (pags_gaussians_create(g, count, sh_degree) != PAGS_OK)
    abort();
  for (int p = 0; p < pags_plane_count(sh_degree); p++)
    for (int64_t i = 0; i < count; i++) {
      double z[2];
      pags_rng_normal2(seed, (uint64_t)p, (uint64_t)i, z);
      double value = p < PAGS_SCALE ? 2 * z[0] : p < PAGS_ROTATION ? z[0] - 4.6 : z[0];
      pags_plane(g, p)[i] = (float)value;
    }
}

/* Plane and name of property k of a PLY with `rest` SH coefficients a channel beyond the constant one; returns -1 for
 * a normal. */
static int property(int k, int rest, char name[24]) {
  static const char *const head[] = {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"};
  static const char *const tail[] = {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"};
  static const int tail_planes[] = {10, 3, 4, 5, 6, 7, 8, 9};
  if (k < 9) {
    snprintf(name, 24, "%s", head[k]);
    return k < 3 ? k : k < 6 ? -1 : 11 + (k - 6);
  }
  if (k < 9 + 3 * rest) {
    int channel = (k - 9) / rest, coefficient = (k - 9) % rest;
    snprintf(name, 24, "f_rest_%d", k - 9);
    return 11 + 3 * (coefficient + 1) + channel;
  }
  snprintf(name, 24, "%s", tail[k - 9 - 3 * rest]);
  return tail_planes[k - 9 - 3 * rest];
}

static int properties(const pags_gaussians *g) {
  return 3 * pags_sh_coefficients(g->sh_degree) + 14;
}

file_bytes make_ply(const pags_gaussians *g) {
  file_bytes out = {0};
  char name[24];
  int rest = pags_sh_coefficients(g->sh_degree) - 1;
  bytes_text(&out, "ply\nformat binary_little_endian 1.0\nelement vertex %d\n", (int)g->count);
  for (int k = 0; k < properties(g); k++) {
    property(k, rest, name);
    bytes_text(&out, "property float %s\n", name);
  }
  bytes_text(&out, "end_header\n");
  for (int64_t i = 0; i < g->count; i++)
    for (int k = 0; k < properties(g); k++) {
      int plane = property(k, rest, name);
      bytes_f32(&out, plane < 0 ? 0.0f : pags_plane(g, plane)[i]);
    }
  return out;
}

static void put_number(file_bytes *out, const char *format, int is_double, float value) {
  if (format[0] == 'a') {
    bytes_text(out, "%.9g ", (double)value);
    return;
  }
  double wide = (double)value;
  uint8_t bytes[8];
  int size = is_double ? 8 : 4;
  memcpy(bytes, is_double ? (const void *)&wide : (const void *)&value, (size_t)size);
  /* The test runs only on little-endian machines. */
  for (int i = 0; i < size; i++)
    bytes_u8(out, bytes[format[7] == 'b' ? size - 1 - i : i]);
}

file_bytes make_scrambled_ply(const pags_gaussians *g, const char *format) {
  file_bytes out = {0};
  char name[24];
  int count = properties(g), rest = pags_sh_coefficients(g->sh_degree) - 1;
  bytes_text(&out, "ply\r\nformat %s\r\ncomment of no account\r\nelement camera 2\r\nproperty uchar id\r\n", format);
  bytes_text(&out, "element vertex %d\r\nproperty float unknown\r\n", (int)g->count);
  for (int k = count - 1; k >= 0; k--) {
    int plane = property(k, rest, name);
    bytes_text(&out, "property %s %s\r\n", plane >= 0 && plane < 3 ? "double" : "float32", name);
  }
  bytes_text(&out, "element face 1\r\nproperty list uchar int vertex_index\r\nend_header\r\n");
  if (format[0] == 'a')
    bytes_text(&out, "1\n2\n");
  else
    bytes_put(&out, "\1\2", 2);
  for (int64_t i = 0; i < g->count; i++) {
    put_number(&out, format, 0, 99);
    for (int k = count - 1; k >= 0; k--) {
      int plane = property(k, rest, name);
      put_number(&out, format, plane >= 0 && plane < 3, plane < 0 ? 7.0f : pags_plane(g, plane)[i]);
    }
  }
  bytes_text(&out, format[0] == 'a' ? "3 0 1 2\n" : "\3abcdabcdabcd");
  return out;
}

static uint32_t random_word(uint64_t seed, uint64_t a, uint64_t b) {
  uint32_t words[4];
  pags_rng_u32x4(seed, a, b, words);
  return words[0];
}

file_bytes make_splat(int64_t count, uint64_t seed) {
  file_bytes out = {0};
  for (int64_t i = 0; i < count; i++) {
    for (uint64_t k = 0; k < 3; k++)
      bytes_f32(&out, (float)(pags_rng_uniform(seed, k, (uint64_t)i) * 4 - 2));
    for (uint64_t k = 3; k < 6; k++)
      bytes_f32(&out, (float)(pags_rng_uniform(seed, k, (uint64_t)i) * 0.1));
    bytes_u32(&out, random_word(seed, 6, (uint64_t)i));
    bytes_u32(&out, random_word(seed, 7, (uint64_t)i));
  }
  return out;
}

file_bytes make_compressed_ply(int64_t count, int sh_degree, int colour_bounds, uint64_t seed) {
  static const char *const stems[] = {"", "scale_", NULL};
  file_bytes out = {0};
  int chunks = (int)((count + 255) / 256), rest = 3 * (pags_sh_coefficients(sh_degree) - 1);
  bytes_text(&out, "ply\nformat binary_little_endian 1.0\nelement chunk %d\n", chunks);
  for (int s = 0; stems[s]; s++)
    for (int k = 0; k < 6; k++)
      bytes_text(&out, "property float %s_%s%c\n", k < 3 ? "min" : "max", stems[s], "xyz"[k % 3]);
  for (int k = 0; k < 6 && colour_bounds; k++)
    bytes_text(&out, "property float %s_%c\n", k < 3 ? "min" : "max", "rgb"[k % 3]);
  bytes_text(&out, "element vertex %d\nproperty uint packed_position\nproperty uint packed_rotation\n", (int)count);
  bytes_text(&out, "property uint packed_scale\nproperty uint packed_color\n");
  if (rest)
    bytes_text(&out, "element sh %d\n", (int)count);
  for (int k = 0; k < rest; k++)
    bytes_text(&out, "property uchar f_rest_%d\n", k);
  bytes_text(&out, "end_header\n");
  for (int c = 0; c < chunks; c++)
    for (int k = 0; k < (colour_bounds ? 18 : 12); k++) /* lower bounds are negative, upper bounds positive */
      bytes_f32(&out, (float)((k / 3 % 2 ? 1 : -1) * pags_rng_uniform(seed, (uint64_t)k, (uint64_t)c)));
  for (int64_t i = 0; i < count; i++)
    for (uint64_t k = 0; k < 4; k++)
      bytes_u32(&out, random_word(seed, 100 + k, (uint64_t)i));
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < rest; k++)
      bytes_u8(&out, random_word(seed, 200 + (uint64_t)k, (uint64_t)i) & 255);
  return out;
}

spz_parts make_spz_parts(int version, uint32_t count, int sh_degree, uint64_t seed) {
  spz_parts parts = {version, sh_degree, 12, 0, count, {{0}}};
  int sizes[6] = {9, 1, 3, 3, version == 2 ? 3 : 4, 3 * ((sh_degree + 1) * (sh_degree + 1) - 1)};
  for (uint64_t s = 0; s < 6; s++)
    for (uint64_t i = 0; i < count * (uint64_t)sizes[s]; i++)
      bytes_u8(&parts.stream[s], random_word(seed, s, i) & 255);
  return parts;
}

void free_spz_parts(spz_parts *parts) {
  for (int s = 0; s < 6; s++)
    bytes_free(&parts->stream[s]);
}

static file_bytes spz_header(const spz_parts *parts, int last) {
  file_bytes out = {0};
  bytes_text(&out, "NGSP");
  bytes_u32(&out, (uint32_t)parts->version);
  bytes_u32(&out, parts->count);
  bytes_u8(&out, (unsigned)parts->sh_degree);
  bytes_u8(&out, (unsigned)parts->fractional_bits);
  bytes_u8(&out, (unsigned)parts->flags);
  bytes_u8(&out, (unsigned)last);
  return out;
}

void bytes_stored(file_bytes *b, const void *data, size_t size) {
  for (size_t at = 0; at < size || at == 0;) {
    const size_t block = size - at < 65535 ? size - at : 65535;
    bytes_u8(b, at + block == size);
    bytes_u32(b, (uint32_t)block | (uint32_t)(~block & 65535) << 16);
    bytes_put(b, (const uint8_t *)data + at, block);
    at += block ? block : 1;
  }
}

static file_bytes gzip_bytes(const file_bytes *plain) {
  file_bytes out = {0};
  z_stream stream = {0};
  uint8_t block[4096];
  if (deflateInit2(&stream, 6, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    abort();
  stream.next_in = plain->data;
  stream.avail_in = (uInt)plain->size;
  do {
    stream.next_out = block;
    stream.avail_out = sizeof block;
    deflate(&stream, Z_FINISH);
    bytes_put(&out, block, sizeof block - stream.avail_out);
  } while (stream.avail_out == 0);
  deflateEnd(&stream);
  return out;
}

static file_bytes pack_v4(const spz_parts *parts) {
  int streams = parts->sh_degree ? 6 : 5;
  file_bytes out = spz_header(parts, streams), packed[6] = {{0}};
  bytes_u32(&out, 32 + 8); /* eight bytes of extensions precede the table */
  for (int i = 0; i < 3; i++)
    bytes_u32(&out, 0);
  bytes_u64(&out, 0x1234);
  for (int s = 0; s < streams; s++) {
    packed[s].capacity = ZSTD_compressBound(parts->stream[s].size);
    packed[s].data = malloc(packed[s].capacity);
    packed[s].size = ZSTD_compress(packed[s].data, packed[s].capacity, parts->stream[s].data, parts->stream[s].size, 3);
    bytes_u64(&out, packed[s].size);
    bytes_u64(&out, parts->stream[s].size);
  }
  for (int s = 0; s < streams; s++) {
    bytes_put(&out, packed[s].data, packed[s].size);
    bytes_free(&packed[s]);
  }
  return out;
}

file_bytes spz_plain(const spz_parts *parts) {
  file_bytes plain = spz_header(parts, 0);
  for (int s = 0; s < 6; s++)
    bytes_put(&plain, parts->stream[s].data, parts->stream[s].size);
  return plain;
}

file_bytes pack_spz(const spz_parts *parts) {
  if (parts->version == 4)
    return pack_v4(parts);
  file_bytes plain = spz_plain(parts);
  file_bytes out = gzip_bytes(&plain);
  bytes_free(&plain);
  return out;
}
