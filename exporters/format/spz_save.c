/* SPDX-License-Identifier: Apache-2.0 */
/* Writes Gaussians as SPZ, versions 3 and 4 as nianticlabs/spz reads them. Its axes are OpenGL's unless the options say
 * otherwise; the record of the coordinate system names them in any case. Positions are 24-bit fixed-point numbers: with
 * the usual 12 bits of fraction they reach to 2048 m; farther ones get fewer bits of fraction. */
#include "exporters/format/splat_save.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include <zstd.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "exporters/format/bake.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"

/* FINE_FRACTION: the bits of fraction that make steps of a millimetre. */
enum { SPZ_STREAMS = 6, MOST_FRACTION = 12, FINE_FRACTION = 10, FLAG_ANTIALIASED = 1, FLAG_EXTENSIONS = 2 };
enum { MOST_RECORDS = 8 + 4 + 8 + PAGS_SPZ_SCENE_BYTES + 8 + 4 };

/* ---- Range ---- */

/* What of a set of Gaussians SPZ's numbers reach. */
typedef struct spz_range {
  int fraction;                                  /* bits after the binary point of positions, 0 to 12 */
  double farthest;                               /* largest coordinate, metres */
  int64_t positions, scales, colours, harmonics; /* Gaussians with such a value out of range */
} spz_range;

static bool fits(double value, int fraction) {
  return floor(ldexp(fabs(value), fraction) + 0.5) <= 8388607;
}

/* Whether Gaussian `i` is within the range of `fraction` bits. */
static bool is_near(const pags_gaussians *g, int64_t i, int fraction) {
  return fits((double)pags_plane(g, PAGS_MEAN)[i], fraction) &&
         fits((double)pags_plane(g, PAGS_MEAN + 1)[i], fraction) &&
         fits((double)pags_plane(g, PAGS_MEAN + 2)[i], fraction);
}

static spz_range find_range(const pags_gaussians *g) {
  spz_range range = {0};
  const int rest = 3 * (pags_sh_coefficients(g->sh_degree) - 1);
  for (int k = 0; k < 3; k++)
    for (int64_t i = 0; i < g->count; i++)
      range.farthest = fmax(range.farthest, fabs((double)pags_plane(g, PAGS_MEAN + k)[i]));
  /* The most bits of fraction that all Gaussians fit in. If that makes steps of more than a millimetre, up to one in a
   * thousand, stray ones, doesn't count. */
  int fraction = MOST_FRACTION;
  while (fraction > 0 && !fits(range.farthest, fraction))
    --fraction;
  for (int finer = MOST_FRACTION; fraction < FINE_FRACTION && finer > fraction; finer--) {
    int64_t beyond = 0;
    for (int64_t i = 0; i < g->count; i++)
      beyond += !is_near(g, i, finer);
    if (beyond <= g->count / 1000)
      fraction = finer;
  }
  range.fraction = fraction;
  for (int64_t i = 0; i < g->count; i++) {
    bool scale = false, colour = false, harmonic = false;
    for (int k = 0; k < 3; k++) {
      scale = scale || ((double)pags_plane(g, PAGS_SCALE + k)[i] + 10) * 16 > 255.5;
      colour = colour || fabs((double)pags_plane(g, PAGS_SH + k)[i] * 0.15) > 0.5 + 0.5 / 255;
    }
    for (int k = 0; k < rest; k++) /* 1 and half a step: 8 / 128 for degree 1, 16 / 128 above */
      harmonic = harmonic || fabs((double)pags_plane(g, PAGS_SH + 3 + k)[i]) > (k / 3 < 3 ? 1.03125 : 1.0625);
    range.positions += !is_near(g, i, range.fraction);
    range.scales += scale;
    range.colours += colour;
    range.harmonics += harmonic;
  }
  return range;
}

/* Reports the data that the file can't store, one line per kind. Steps of less than a millimetre are no loss. */
static void say_range(const char *path, const spz_range *range) {
  const double reach = ldexp(8388607, -range->fraction), usual = ldexp(8388607, -MOST_FRACTION);
  if (range->fraction < MOST_FRACTION)
    pags_log_message(range->fraction < FINE_FRACTION ? PAGS_LOG_WARNING : PAGS_LOG_INFO,
                     "%s: positions are in steps of %g m, not of %g m, since they lie up to %g m from zero: beyond "
                     "SPZ's range of %.0f m",
                     path, ldexp(1, -range->fraction), ldexp(1, -MOST_FRACTION), range->farthest, usual);
  if (range->positions)
    PAGS_WARN("%s: %lld Gaussians farther than %.0f m from zero are left out: beyond SPZ's range", path,
              (long long)range->positions, reach);
  if (range->scales)
    PAGS_WARN("%s: %lld Gaussians beyond SPZ's range of sigma are clamped to 379 m", path, (long long)range->scales);
  if (range->colours)
    PAGS_WARN("%s: %lld Gaussians have colours beyond SPZ's range, which are clamped", path, (long long)range->colours);
  if (range->harmonics)
    PAGS_WARN("%s: %lld Gaussians have spherical harmonics beyond SPZ's range of -1 to 1, which are clamped", path,
              (long long)range->harmonics);
}

/* ---- Attributes ---- */

/* How values are packed: positions' bits of fraction, the signs of the axes. */
typedef struct spz_packing {
  int fraction, vector[3], harmonics[15], determinant;
} spz_packing;

typedef struct spz_streams {
  uint8_t *bytes[SPZ_STREAMS]; /* positions, opacities, colours, scales, rotations, SH */
  size_t sizes[SPZ_STREAMS];
} spz_streams;

static void forget_streams(spz_streams *s) {
  for (int k = 0; k < SPZ_STREAMS; k++)
    free(s->bytes[k]);
}

/* SPZ's "smallest three" packing of a unit quaternion: two bits for the index of the largest component, which is left
 * out, then the other three with ten bits each: a sign bit and nine bits of magnitude relative to 1 / sqrt 2. Signs
 * are flipped so that the component left out is positive. */
static uint32_t pack_rotation(const double xyzw[4]) {
  int largest = 0;
  for (int k = 1; k < 4; k++)
    largest = fabs(xyzw[k]) > fabs(xyzw[largest]) ? k : largest;
  uint32_t word = (uint32_t)largest;
  const bool flip = xyzw[largest] < 0;
  for (int k = 0; k < 4; k++) {
    if (k == largest)
      continue;
    uint32_t magnitude = (uint32_t)fmin(floor(511 * fabs(xyzw[k]) / 0.70710678118654752 + 0.5), 511);
    uint32_t negative = (xyzw[k] < 0) != flip;
    word = word << 10 | negative << 9 | magnitude;
  }
  return word;
}

static void pack_row(const pags_gaussians *g, const spz_packing *p, int64_t i, spz_streams *s) {
  double q[4];
  pags_splat_rotation(g, i, q);
  for (int k = 0; k < 3; k++) {
    double value = (double)pags_plane(g, PAGS_MEAN + k)[i] * p->vector[k];
    int32_t fixed = (int32_t)fmin(fmax(floor(ldexp(value, p->fraction) + 0.5), -8388608), 8388607);
    for (int b = 0; b < 3; b++)
      s->bytes[0][9 * i + 3 * k + b] = (uint8_t)((uint32_t)fixed >> 8 * b);
    s->bytes[2][3 * i + k] = pags_splat_byte((double)pags_plane(g, PAGS_SH + k)[i] * 0.15 * 255 + 127.5);
    s->bytes[3][3 * i + k] = pags_splat_byte(((double)pags_plane(g, PAGS_SCALE + k)[i] + 10) * 16);
  }
  s->bytes[1][i] = pags_splat_byte(255 * pags_splat_opacity(g, i));
  const int *const v = p->vector, d = p->determinant;
  const double xyzw[4] = {d * v[0] * q[1], d * v[1] * q[2], d * v[2] * q[3], q[0]};
  pags_store_u32(s->bytes[4] + 4 * i, pack_rotation(xyzw));
  int rest = pags_sh_coefficients(g->sh_degree) - 1;
  /* Harmonics are bytes in multiples of 8 for degree 1, 16 for higher degrees, as in the reference implementation. The
   * coarse steps are what makes the stream compress well. */
  for (int k = 0; k < 3 * rest; k++) {
    const int step = k / 3 < 3 ? 8 : 16;
    const double value = p->harmonics[k / 3] * (double)pags_plane(g, PAGS_SH + 3 + k)[i];
    const double quantised = floor(value * 128 + 0.5) + 128;
    s->bytes[5][(int64_t)3 * rest * i + k] = (uint8_t)fmin(fmax(floor((quantised + step / 2.0) / step) * step, 0), 255);
  }
}

static pags_result pack_streams(const pags_gaussians *g, const spz_packing *p, spz_streams *s) {
  const size_t each[SPZ_STREAMS] = {9, 1, 3, 3, 4, 3 * ((size_t)pags_sh_coefficients(g->sh_degree) - 1)};
  bool complete = true;
  for (int k = 0; k < SPZ_STREAMS; k++) {
    s->sizes[k] = each[k] * (size_t)g->count;
    s->bytes[k] = malloc(s->sizes[k] + 1);
    complete = complete && s->bytes[k];
  }
  PAGS_CHECK_MEMORY(complete, "%lld Gaussians", (long long)g->count);
  for (int64_t i = 0; i < g->count; i++)
    pack_row(g, p, i, s);
  return PAGS_OK;
}

/* ---- Files ---- */

/* The header and the extension records. */
typedef struct spz_head {
  uint8_t bytes[32], records[MOST_RECORDS];
  size_t record_bytes;
} spz_head;

static void end_deflate(z_stream *z) {
  deflateEnd(z);
}

/* Deflates the header, then the streams, then the records as one gzip stream. */
static pags_result save_gzip(const char *path, const spz_streams *s, const spz_head *head) {
  enum { BLOCK = 1 << 16 };
  PAGS_AUTO(pags_file_writer_abort) pags_file_writer file = {0};
  PAGS_AUTO(end_deflate) z_stream z = {0};
  if (deflateInit2(&z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    return pags_out_of_memory("%s", path);
  gz_header same = {.os = 3}; /* zlib would write the number of this system, so that files differed */
  deflateSetHeader(&z, &same);
  PAGS_TRY(pags_file_writer_begin(&file, path));
  PAGS_AUTOFREE uint8_t *out = malloc(BLOCK);
  PAGS_CHECK_MEMORY(out, NULL);
  for (int k = -1; k <= SPZ_STREAMS; k++) {
    const bool last = k == SPZ_STREAMS;
    const uint8_t *from = k < 0 ? head->bytes : last ? head->records : s->bytes[k];
    size_t left = k < 0 ? 16 : last ? head->record_bytes : s->sizes[k];
    do {
      size_t step = left < 1u << 30 ? left : 1u << 30;
      z.next_in = (z_const Bytef *)(uintptr_t)from;
      z.avail_in = (uInt)step;
      left -= step;
      from += step;
      do {
        z.next_out = out;
        z.avail_out = BLOCK;
        deflate(&z, last && !left ? Z_FINISH : Z_NO_FLUSH);
        PAGS_TRY(pags_file_writer_put(&file, out, BLOCK - z.avail_out));
      } while (z.avail_out == 0);
    } while (left);
  }
  return pags_file_writer_commit(&file);
}

/* Version 4: a header of 32 bytes, the records, a table of each stream's size packed and unpacked, then the streams,
 * each packed by zstd. The stream of harmonics is left out at degree 0. */
static pags_result save_zstd(const char *path, const spz_streams *s, spz_head *head) {
  const int count = s->sizes[5] ? SPZ_STREAMS : SPZ_STREAMS - 1;
  uint8_t table[16 * SPZ_STREAMS];
  PAGS_AUTO(pags_file_writer_abort) pags_file_writer file = {0};
  PAGS_AUTO(forget_streams) spz_streams packed = {0};
  head->bytes[15] = (uint8_t)count;
  pags_store_u32(head->bytes + 16, 32 + (uint32_t)head->record_bytes);
  for (int k = 0; k < count; k++) {
    size_t bound = ZSTD_compressBound(s->sizes[k]);
    packed.bytes[k] = malloc(bound);
    if (packed.bytes[k])
      packed.sizes[k] = ZSTD_compress(packed.bytes[k], bound, s->bytes[k], s->sizes[k], 9);
    PAGS_CHECK_MEMORY(packed.bytes[k] && !ZSTD_isError(packed.sizes[k]), "%s", path);
    pags_store_u64(table + 16 * k, packed.sizes[k]);
    pags_store_u64(table + 16 * k + 8, s->sizes[k]);
  }
  PAGS_TRY(pags_file_writer_begin(&file, path));
  PAGS_TRY(pags_file_writer_put(&file, head->bytes, 32));
  PAGS_TRY(pags_file_writer_put(&file, head->records, head->record_bytes));
  PAGS_TRY(pags_file_writer_put(&file, table, 16 * (size_t)count));
  for (int k = 0; k < count; k++)
    PAGS_TRY(pags_file_writer_put(&file, packed.bytes[k], packed.sizes[k]));
  return pags_file_writer_commit(&file);
}

/* Writes the records: the coordinate system, and, unless a reader takes the same anyway, PAGS' own of the scene. */
static void put_records(const pags_spz_options *options, spz_head *head) {
  const pags_splat_facts *const facts = options->facts;
  uint8_t *at = head->records;
  pags_store_u32(at, PAGS_SPZ_AXES_RECORD);
  pags_store_u32(at + 4, 4);
  pags_store_u32(at + 8, (uint32_t)options->axes);
  at += 12;
  if (facts && (facts->up == PAGS_UP_Z || facts->up == PAGS_UP_Y || facts->origin[0] != 0 || facts->origin[1] != 0 ||
                facts->origin[2] != 0)) {
    pags_store_u32(at, PAGS_SPZ_SCENE_RECORD);
    pags_store_u32(at + 4, PAGS_SPZ_SCENE_BYTES);
    pags_store_u32(at + 8, (uint32_t)facts->up);
    for (int k = 0; k < 3; k++)
      pags_store_f64(at + 12 + 8 * k, facts->origin[k]);
    at += 8 + PAGS_SPZ_SCENE_BYTES;
  }
  if (facts && facts->converted_from > 0.0f) {
    pags_store_u32(at, PAGS_SPZ_CUT_RECORD);
    pags_store_u32(at + 4, 4);
    pags_store_f32(at + 8, facts->converted_from);
    at += 12;
  }
  head->record_bytes = (size_t)(at - head->records);
}

/* Saves Gaussians that are all within the range. */
static pags_result save_near(const char *path, const pags_gaussians *g, const pags_spz_options *options, int fraction) {
  PAGS_AUTO(forget_streams) spz_streams streams = {0};
  spz_head head = {0};
  spz_packing packing = {.fraction = fraction};
  pags_axes_signs(options->axes, packing.vector, packing.harmonics);
  packing.determinant = packing.vector[0] * packing.vector[1] * packing.vector[2];
  PAGS_TRY(pack_streams(g, &packing, &streams));

  /* The header: magic "NGSP", version, count, degree, bits of fraction, flags. */
  pags_store_u32(head.bytes, 0x5053474e);
  pags_store_u32(head.bytes + 4, (uint32_t)options->version);
  pags_store_u32(head.bytes + 8, (uint32_t)g->count);
  head.bytes[12] = (uint8_t)g->sh_degree;
  head.bytes[13] = (uint8_t)fraction;
  head.bytes[14] = FLAG_EXTENSIONS | (options->facts && options->facts->antialiased ? FLAG_ANTIALIASED : 0);
  put_records(options, &head);
  return options->version == 4 ? save_zstd(path, &streams, &head) : save_gzip(path, &streams, &head);
}

pags_result pags_spz_save(const char *path, const pags_gaussians *g, const pags_spz_options *options) {
  if (g->count > UINT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %lld Gaussians are too many for SPZ", path, (long long)g->count);
  const spz_range range = find_range(g);
  if (range.positions && range.positions == g->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: all Gaussians are farther than 8388607 m from zero, beyond SPZ's range",
                     path);
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians near = {0};
  if (range.positions) {
    PAGS_AUTOFREE int64_t *index = malloc((size_t)g->count * sizeof *index);
    int64_t count = 0;
    PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)g->count);
    for (int64_t i = 0; i < g->count; i++)
      if (is_near(g, i, range.fraction))
        index[count++] = i;
    PAGS_TRY(pags_gaussians_create_like(&near, count, g));
    pags_gaussians_gather(g, index, count, &near);
  }
  PAGS_TRY(save_near(path, range.positions ? &near : g, options, range.fraction));
  say_range(path, &range);
  return PAGS_OK;
}
