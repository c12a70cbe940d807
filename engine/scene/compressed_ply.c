/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes PlayCanvas' compressed PLY: chunks of 256 Gaussians, each with bounds, four packed words per Gaussian, and
 * spherical harmonics as bytes.
 *
 * word      bits                      value
 * position  11 10 11                  x y z between the chunk's bounds
 * rotation  2 10 10 10                index of the largest of w x y z, the other three in order, +- 1/sqrt 2
 * scale     11 10 11                  ln sigma between the chunk's bounds
 * colour    8 8 8 8                   r g b between the chunk's bounds (0 and 1 in older files), opacity 0..1 */
#include <math.h>
#include <stdio.h>

#include "base/file.h"
#include "base/log.h"
#include "scene/splat_formats.h"

enum { CHUNK_ROWS = 256, BOUNDS = 18 };

static const char *const bound_names[BOUNDS] = {
    "min_x",       "min_y",       "min_z",       "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y", "min_scale_z",
    "max_scale_x", "max_scale_y", "max_scale_z", "min_r", "min_g", "min_b", "max_r",       "max_g",       "max_b"};
static const char *const word_names[4] = {"packed_position", "packed_rotation", "packed_scale", "packed_color"};

typedef struct reader {
  const ply_table *table;
  const ply_element *chunk, *vertex, *sh;
  const ply_property *bounds[BOUNDS]; /* NULL for the colour bounds (the last six) in files that have none */
  const ply_property *words[4];
} reader;

/* Finds the elements and properties of the format in `table` and checks that their rows are all in the file and that
 * there is a chunk for every 256 vertices. */
static pags_result bind(reader *r, const ply_table *table) {
  *r = (reader){.table = table,
                .chunk = pags_ply_table_find(table, "chunk"),
                .vertex = pags_ply_table_find(table, "vertex"),
                .sh = pags_ply_table_find(table, "sh")};
  if (!r->chunk)
    return pags_fail_at(table->path, "expected an element 'chunk' of a compressed PLY");
  for (int i = 0; i < BOUNDS; i++) {
    r->bounds[i] = pags_ply_property_find(table, r->chunk, bound_names[i]);
    if (!r->bounds[i] && (i < 12 || r->bounds[12]))
      return pags_fail_at(table->path, "no property '%s' in element 'chunk'", bound_names[i]);
  }
  for (int i = 0; i < 4; i++) {
    r->words[i] = pags_ply_property_find(table, r->vertex, word_names[i]);
    if (!r->words[i] || r->words[i]->type != PLY_UINT)
      return pags_fail_at(table->path, "no property '%s' of type uint in element 'vertex'", word_names[i]);
  }
  PAGS_TRY(pags_ply_table_need(table, r->chunk));
  PAGS_TRY(pags_ply_table_need(table, r->vertex));
  const int64_t chunks = r->vertex->count / CHUNK_ROWS + (r->vertex->count % CHUNK_ROWS != 0);
  if (r->chunk->count < chunks)
    return pags_fail_at(table->path, "expected %lld chunks for %lld vertices, found %lld", (long long)chunks,
                        (long long)r->vertex->count, (long long)r->chunk->count);
  if (!r->sh)
    return PAGS_OK;
  if (pags_ply_degree(r->sh->property_count) < 1 || r->sh->count != r->vertex->count)
    return pags_fail_at(table->path,
                        "expected 9, 24, 45 or 72 properties and %lld rows in element 'sh', found %d and %lld",
                        (long long)r->vertex->count, r->sh->property_count, (long long)r->sh->count);
  return pags_ply_table_need(table, r->sh);
}

/* Returns bits [shift, shift + bits) of `word` divided by their largest value: 0..1. */
static double unit(uint32_t word, int shift, int bits) {
  uint32_t mask = (1u << bits) - 1;
  return (double)(word >> shift & mask) / (double)mask;
}

/* A bound may be infinite, as the lower one of scales is where an axis has vanished: t = 0 is then the bound itself,
 * and a value between an infinite and a finite bound is unknown: the finite bound is the best guess. */
static double mix(double lo, double hi, double t) {
  if (isinf(lo) || isinf(hi))
    return t > 0 ? hi : lo;
  return lo * (1 - t) + hi * t;
}

/* Unpacks 11, 10 and 11 bits into three planes from `plane` on: values between lo[k] and hi[k]. */
static void unpack_vector(uint32_t word, const double *lo, const double *hi, int plane, int64_t row,
                          pags_gaussians *out) {
  static const int shifts[3] = {21, 11, 0}, bits[3] = {11, 10, 11};
  for (int k = 0; k < 3; k++)
    pags_plane(out, plane + k)[row] = (float)mix(lo[k], hi[k], unit(word, shifts[k], bits[k]));
}

/* Unpacks the coefficients of degrees 1 and above: a byte encodes a value in -4..4, and the order is channel-major
 * as in INRIA's PLY. */
static pags_result unpack_sh(const reader *r, pags_gaussians *out) {
  const int rest = pags_sh_coefficients(out->sh_degree) - 1, stored = r->sh->property_count / 3;
  for (int i = 0; i < 3 * rest; i++) {
    char name[24];
    snprintf(name, sizeof name, "f_rest_%d", i / rest * stored + i % rest);
    const ply_property *property = pags_ply_property_find(r->table, r->sh, name);
    if (!property)
      return pags_fail_at(r->table->path, "no property '%s' in element 'sh'", name);
    float *plane = pags_plane(out, PAGS_SH + 3 * (1 + i % rest) + i / rest);
    for (int64_t row = 0; row < out->count; row++)
      plane[row] = (float)(pags_ply_value(r->table, r->sh, property, row) * (8.0 / 255.0) - 4.0);
  }
  return PAGS_OK;
}

pags_result pags_compressed_ply_decode(const ply_table *table, pags_gaussians *out, double origin[3]) {
  reader r;
  PAGS_TRY(bind(&r, table));
  PAGS_TRY(pags_splat_create(table->path, r.vertex->count, r.sh ? pags_ply_degree(r.sh->property_count) : 0, out));
  for (int k = 0; k < 3; k++) /* positions have more digits than the bounds that they lie between */
    origin[k] = pags_ply_origin(table, r.chunk, r.bounds[k]);
  int64_t infinite = 0;
  for (int64_t chunk = 0; chunk * CHUNK_ROWS < out->count; chunk++) {
    /* Colour bounds are 0 and 1 unless the file has them. */
    double bounds[BOUNDS] = {[15] = 1, [16] = 1, [17] = 1};
    for (int i = 0; i < BOUNDS; i++)
      if (r.bounds[i])
        bounds[i] = pags_ply_value(r.table, r.chunk, r.bounds[i], chunk) - (i < 6 ? origin[i % 3] : 0);
    infinite += isinf(bounds[6]) || isinf(bounds[7]) || isinf(bounds[8]);
    for (int64_t row = chunk * CHUNK_ROWS; row < out->count && row < (chunk + 1) * CHUNK_ROWS; row++) {
      uint32_t words[4];
      for (int i = 0; i < 4; i++)
        words[i] = (uint32_t)pags_ply_value(r.table, r.vertex, r.words[i], row);
      unpack_vector(words[0], bounds, bounds + 3, PAGS_MEAN, row, out);
      const int largest = (int)(words[1] >> 30);
      double q[4];
      for (int k = 0, shift = 20; k < 4; k++)
        if (k != largest) {
          q[k] = (unit(words[1], shift, 10) - 0.5) * 1.4142135623730951;
          shift -= 10;
        }
      pags_splat_put_rotation(q, largest, row, out);
      unpack_vector(words[2], bounds + 6, bounds + 9, PAGS_SCALE, row, out);

      /* Colour 0..1 to the constant SH coefficient, opacity byte to its logit. */
      const double *lo = bounds + 12;
      const double *hi = bounds + 15;
      for (int k = 0; k < 3; k++) {
        double colour = mix(lo[k], hi[k], unit(words[3], 24 - 8 * k, 8));
        pags_plane(out, PAGS_SH + k)[row] = (float)((colour - 0.5) / PAGS_SH_C0);
      }
      pags_plane(out, PAGS_OPACITY)[row] = pags_logit_of_byte((uint8_t)words[3]);
    }
  }
  if (infinite)
    PAGS_WARN(
        "%s: %lld of %lld chunks have a lower bound of scale of -inf, so that the scales between the bounds are lost",
        table->path, (long long)infinite, (long long)r.chunk->count);
  return r.sh ? unpack_sh(&r, out) : PAGS_OK;
}
