/* SPDX-License-Identifier: Apache-2.0 */
/* Bakes the parts of a scene at one time into one set of Gaussians in the world's frame: means and rotations are
 * moved by the part's rigid motion, spherical harmonics are rotated by sh_rotate.c. Writes such a set as .splat and
 * as SPZ. */
#include "exporters/format/bake.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "maths/maths.h"

/* ---- Baking ---- */

/* Writes Gaussian `i` of a part as Gaussian `at` of `out`, moved by the part's pose. `turn_q` is the pose's rotation
 * as a quaternion, `turn` its rotation of harmonics; `turn` NULL: the pose doesn't rotate, and rotations and
 * harmonics are copied to the bit. */
static void bake_row(const pags_part *part, const pags_sh_rotation *turn, const double turn_q[4], int64_t i,
                     pags_gaussians *out, int64_t at) {
  const pags_gaussians *g = part->gaussians;
  const double *m = part->world_from_model;
  double p[3], q[4], rest[15];
  int degree = out->sh_degree < g->sh_degree ? out->sh_degree : g->sh_degree;
  for (int k = 0; k < 3; k++)
    p[k] = (double)pags_plane(g, PAGS_MEAN + k)[i];
  for (int k = 0; k < 4; k++)
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
  const double *t = turn_q;
  const double product[4] = {
      t[0] * q[0] - t[1] * q[1] - t[2] * q[2] - t[3] * q[3], t[0] * q[1] + t[1] * q[0] + t[2] * q[3] - t[3] * q[2],
      t[0] * q[2] - t[1] * q[3] + t[2] * q[0] + t[3] * q[1], t[0] * q[3] + t[1] * q[2] - t[2] * q[1] + t[3] * q[0]};
  for (int k = 0; k < 3; k++) {
    pags_plane(out, PAGS_MEAN + k)[at] =
        (float)(m[4 * k] * p[0] + m[4 * k + 1] * p[1] + m[4 * k + 2] * p[2] + m[4 * k + 3]);
    pags_plane(out, PAGS_SCALE + k)[at] = pags_plane(g, PAGS_SCALE + k)[i];
    pags_plane(out, PAGS_SH + k)[at] = part->dc ? part->dc[k * g->stride + i] : pags_plane(g, PAGS_SH + k)[i];
  }
  for (int k = 0; k < 4; k++)
    pags_plane(out, PAGS_ROTATION + k)[at] = turn ? (float)product[k] : (float)q[k];
  pags_plane(out, PAGS_OPACITY)[at] = pags_plane(g, PAGS_OPACITY)[i];
  for (int c = 0; c < 3 && degree; c++) {
    int count = pags_sh_coefficients(degree) - 1;
    for (int k = 0; k < count; k++)
      rest[k] = (double)pags_plane(g, PAGS_SH + 3 * (k + 1) + c)[i];
    if (turn)
      pags_sh_rotation_apply(turn, degree, rest);
    for (int k = 0; k < count; k++)
      pags_plane(out, PAGS_SH + 3 * (k + 1) + c)[at] = (float)rest[k];
  }
}

static bool is_turned(const double m[12]) {
  static const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  for (int i = 0; i < 9; i++)
    if (m[4 * (i / 3) + i % 3] != identity[i])
      return true;
  return false;
}

static void bake_part(const pags_part *part, pags_gaussians *out, int64_t first) {
  const double *m = part->world_from_model;
  const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  double q[4];
  pags_sh_rotation turn;
  int turned = is_turned(m);
  pags_quaternion_from_rotation(r, q);
  pags_sh_rotation_make(r, &turn);
  for (int64_t i = 0; i < part->gaussians->count; i++) {
    bake_row(part, turned ? &turn : NULL, q, i, out, first + i);
    if (out->s_sem)
      out->s_sem[first + i] = part->gaussians->s_sem[i];
    if (out->object_id && part->gaussians->object_id)
      out->object_id[first + i] = part->gaussians->object_id[i];
  }
}

pags_result pags_splats_bake(const pags_part *parts, int count, int sh_degree, pags_gaussians *out) {
  int64_t total = 0, first = 0;
  int s_sem = count > 0;
  for (int i = 0; i < count; i++) {
    total += parts[i].gaussians->count;
    s_sem = s_sem && parts[i].gaussians->s_sem;
  }
  PAGS_TRY(pags_gaussians_create(out, total, sh_degree));
  pags_result result = s_sem ? pags_gaussians_add_s_sem(out) : PAGS_OK;
  for (int i = 0; i < count && result == PAGS_OK; i++) {
    bake_part(&parts[i], out, first);
    first += parts[i].gaussians->count;
  }
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  return result;
}

/* ---- The .splat file ---- */

static uint8_t to_byte(double value) {
  return (uint8_t)fmin(fmax(floor(value + 0.5), 0), 255);
}

static double opacity_of(const pags_gaussians *g, int64_t i) {
  return 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
}

/* The rotation of Gaussian `i` as a unit quaternion w, x, y, z. */
static void rotation_of(const pags_gaussians *g, int64_t i, double q[4]) {
  double length = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
    length += q[k] * q[k];
  }
  for (int k = 0; k < 4; k++)
    q[k] = length > 0 ? q[k] / sqrt(length) : k == 0;
}

/* A .splat file has 32 bytes a Gaussian: position and scales (standard deviations) as floats, then colour, opacity
 * and rotation as bytes. The Gaussians keep their order. */
pags_result pags_splat_save(const char *path, const pags_gaussians *g) {
  uint8_t *bytes = calloc((size_t)g->count + 1, 32);
  if (!bytes)
    return pags_out_of_memory("%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count; i++) {
    uint8_t *row = bytes + 32 * i;
    double q[4];
    rotation_of(g, i, q);
    for (int k = 0; k < 3; k++) {
      pags_store_f32(row + 4 * k, pags_plane(g, PAGS_MEAN + k)[i]);
      pags_store_f32(row + 12 + 4 * k, (float)pags_exp((double)pags_plane(g, PAGS_SCALE + k)[i]));
      row[24 + k] = to_byte(255 * (0.5 + PAGS_SH_C0 * (double)pags_plane(g, PAGS_SH + k)[i]));
    }
    row[27] = to_byte(255 * opacity_of(g, i));
    for (int k = 0; k < 4; k++)
      row[28 + k] = to_byte(128 + 128 * q[k]);
  }
  pags_result result = pags_file_write(path, bytes, 32 * (size_t)g->count);
  free(bytes);
  return result;
}

/* ---- SPZ ---- */

/* Versions 3 and 4 as nianticlabs/spz reads them. SPZ has OpenGL's axes, half a turn about x from ours: y and z of
 * means and quaternions change sign, and the harmonics by `signs` in pack_row. SPZ_FRACTION: bits after the binary
 * point of the 24-bit fixed-point positions. */
enum { SPZ_STREAMS = 6, SPZ_FRACTION = 12 };

typedef struct spz_streams {
  uint8_t *bytes[SPZ_STREAMS]; /* positions, opacities, colours, scales, rotations, SH */
  size_t sizes[SPZ_STREAMS];
} spz_streams;

/* SPZ's "smallest three" packing of a unit quaternion: two bits for the index of the largest component, which is left
 * out, then the other three with ten bits each: a sign bit and nine bits of magnitude relative to 1 / sqrt 2. Signs
 * are flipped so that the component left out is positive. */
static uint32_t pack_rotation(const double xyzw[4]) {
  int largest = 0;
  for (int k = 1; k < 4; k++)
    largest = fabs(xyzw[k]) > fabs(xyzw[largest]) ? k : largest;
  uint32_t word = (uint32_t)largest;
  int flip = xyzw[largest] < 0;
  for (int k = 0; k < 4; k++) {
    if (k == largest)
      continue;
    uint32_t magnitude = (uint32_t)fmin(floor(511 * fabs(xyzw[k]) / 0.70710678118654752 + 0.5), 511);
    uint32_t negative = (xyzw[k] < 0) != flip;
    word = word << 10 | negative << 9 | magnitude;
  }
  return word;
}

/* Quantises a harmonic coefficient to a byte in multiples of `step`: 8 for degree 1, 16 for higher degrees, as the
 * reference implementation does. The coarse steps are what makes the stream compress well. */
static uint8_t pack_sh(double value, int step) {
  double quantised = floor(value * 128 + 0.5) + 128;
  return (uint8_t)fmin(fmax(floor((quantised + step / 2.0) / step) * step, 0), 255);
}

static void pack_row(const pags_gaussians *g, int64_t i, spz_streams *s) {
  static const signed char signs[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};
  double q[4];
  rotation_of(g, i, q);
  for (int k = 0; k < 3; k++) {
    double value = (double)pags_plane(g, PAGS_MEAN + k)[i] * (k ? -1 : 1);
    int32_t fixed = (int32_t)fmin(fmax(floor(ldexp(value, SPZ_FRACTION) + 0.5), -8388608), 8388607);
    for (int b = 0; b < 3; b++)
      s->bytes[0][9 * i + 3 * k + b] = (uint8_t)((uint32_t)fixed >> 8 * b);
    s->bytes[2][3 * i + k] = to_byte((double)pags_plane(g, PAGS_SH + k)[i] * 0.15 * 255 + 127.5);
    s->bytes[3][3 * i + k] = to_byte(((double)pags_plane(g, PAGS_SCALE + k)[i] + 10) * 16);
  }
  s->bytes[1][i] = to_byte(255 * opacity_of(g, i));
  const double xyzw[4] = {q[1], -q[2], -q[3], q[0]};
  pags_store_u32(s->bytes[4] + 4 * i, pack_rotation(xyzw));
  int rest = pags_sh_coefficients(g->sh_degree) - 1;
  for (int k = 0; k < 3 * rest; k++)
    s->bytes[5][(int64_t)3 * rest * i + k] =
        pack_sh(signs[k / 3] * (double)pags_plane(g, PAGS_SH + 3 + k)[i], k / 3 < 3 ? 8 : 16);
}

static pags_result pack_streams(const pags_gaussians *g, spz_streams *s) {
  const size_t each[SPZ_STREAMS] = {9, 1, 3, 3, 4, 3 * ((size_t)pags_sh_coefficients(g->sh_degree) - 1)};
  bool complete = true;
  for (int k = 0; k < SPZ_STREAMS; k++) {
    s->sizes[k] = each[k] * (size_t)g->count;
    s->bytes[k] = malloc(s->sizes[k] + 1);
    complete = complete && s->bytes[k];
  }
  if (!complete)
    return pags_out_of_memory("%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count; i++)
    pack_row(g, i, s);
  return PAGS_OK;
}

/* Deflates the header and then the streams into `file` as one gzip stream. */
static pags_result deflate_pieces(z_stream *z, const spz_streams *s, const uint8_t header[16], pags_file_writer *file) {
  enum { BLOCK = 1 << 16 };
  uint8_t *out = malloc(BLOCK);
  if (!out)
    return pags_out_of_memory(NULL);
  pags_result result = PAGS_OK;
  for (int k = -1; k < SPZ_STREAMS && result == PAGS_OK; k++) {
    const uint8_t *from = k < 0 ? header : s->bytes[k];
    size_t left = k < 0 ? 16 : s->sizes[k];
    int last = k == SPZ_STREAMS - 1;
    do {
      size_t step = left < 1u << 30 ? left : 1u << 30;
      z->next_in = (z_const Bytef *)(uintptr_t)from;
      z->avail_in = (uInt)step;
      left -= step;
      from += step;
      do {
        z->next_out = out;
        z->avail_out = BLOCK;
        deflate(z, last && !left ? Z_FINISH : Z_NO_FLUSH);
        result = pags_file_writer_put(file, out, BLOCK - z->avail_out);
      } while (result == PAGS_OK && z->avail_out == 0);
    } while (left && result == PAGS_OK);
  }
  free(out);
  return result;
}

static pags_result save_gzip(const char *path, const spz_streams *s, const uint8_t header[16]) {
  pags_file_writer file = {0};
  z_stream z = {0};
  if (deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    return pags_out_of_memory("%s", path);
  gz_header same = {.os = 3}; /* zlib would write the number of this system, so that files differed */
  deflateSetHeader(&z, &same);
  pags_result result = pags_file_writer_begin(&file, path);
  if (result == PAGS_OK)
    result = deflate_pieces(&z, s, header, &file);
  deflateEnd(&z);
  if (result == PAGS_OK)
    return pags_file_writer_commit(&file);
  pags_file_writer_abort(&file);
  return result;
}

/* Version 4: a header of 32 bytes, a table of each stream's size packed and unpacked, then the streams, each packed
 * by zstd. The stream of harmonics is left out at degree 0. */
static pags_result save_zstd(const char *path, const spz_streams *s, uint8_t header[32]) {
  int streams = s->sizes[5] ? SPZ_STREAMS : SPZ_STREAMS - 1;
  uint8_t *packed[SPZ_STREAMS] = {NULL}, table[16 * SPZ_STREAMS];
  pags_file_writer file = {0};
  pags_result result = PAGS_OK;
  size_t sizes[SPZ_STREAMS];
  header[15] = (uint8_t)streams;
  memset(header + 16, 0, 16);
  pags_store_u32(header + 16, 32);
  for (int k = 0; k < streams && result == PAGS_OK; k++) {
    size_t bound = ZSTD_compressBound(s->sizes[k]);
    packed[k] = malloc(bound);
    sizes[k] = packed[k] ? ZSTD_compress(packed[k], bound, s->bytes[k], s->sizes[k], 9) : 0;
    if (!packed[k] || ZSTD_isError(sizes[k]))
      result = pags_out_of_memory("%s", path);
    pags_store_u64(table + 16 * k, sizes[k]);
    pags_store_u64(table + 16 * k + 8, s->sizes[k]);
  }
  if (result == PAGS_OK)
    result = pags_file_writer_begin(&file, path);
  if (result == PAGS_OK)
    result = pags_file_writer_put(&file, header, 32);
  if (result == PAGS_OK)
    result = pags_file_writer_put(&file, table, 16 * (size_t)streams);
  for (int k = 0; k < streams && result == PAGS_OK; k++)
    result = pags_file_writer_put(&file, packed[k], sizes[k]);
  if (result == PAGS_OK)
    result = pags_file_writer_commit(&file);
  else
    pags_file_writer_abort(&file);
  for (int k = 0; k < streams; k++)
    free(packed[k]);
  return result;
}

pags_result pags_spz_save(const char *path, const pags_gaussians *g, int version, int antialiased) {
  spz_streams streams = {{NULL}, {0}};
  uint8_t header[32];
  if (g->count > UINT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %lld Gaussians are too many for SPZ", path, (long long)g->count);
  pags_result result = pack_streams(g, &streams);

  /* The header: magic "NGSP", version, count, degree, bits of fraction, flags (bit 0: trained with antialiasing). */
  pags_store_u32(header, 0x5053474e);
  pags_store_u32(header + 4, (uint32_t)version);
  pags_store_u32(header + 8, (uint32_t)g->count);
  header[12] = (uint8_t)g->sh_degree;
  header[13] = SPZ_FRACTION;
  header[14] = antialiased ? 1 : 0;
  header[15] = 0;

  if (result == PAGS_OK)
    result = version == 4 ? save_zstd(path, &streams, header) : save_gzip(path, &streams, header);
  for (int k = 0; k < SPZ_STREAMS; k++)
    free(streams.bytes[k]);
  return result;
}
