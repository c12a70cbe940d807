/* SPDX-License-Identifier: Apache-2.0 */
/* The order of Gaussians along a Morton curve (Morton 1966), by a radix sort of 63-bit codes: Gaussians that are
 * neighbours in memory are then neighbours in space, so that the bounds of clusters are small. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include <pags/gaussians.h>

#include "base/memory.h"

enum { AXIS_BITS = 21, DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS, PASSES = 6 }; /* 6 digits of 11 bits hold a code */

typedef struct keyed_row {
  uint64_t code;
  int64_t row;
} keyed_row;

/* The bounding cube of all finite means, divided into 2^21 cells a side. A cube rather than a box, so that the cells
 * are cubes whatever the shape of the scene. */
typedef struct cube {
  double lo[3], cells_per_metre;
} cube;

static bool is_finite_mean(const pags_gaussians *g, int64_t i) {
  return isfinite(pags_plane(g, PAGS_MEAN)[i]) && isfinite(pags_plane(g, PAGS_MEAN + 1)[i]) &&
         isfinite(pags_plane(g, PAGS_MEAN + 2)[i]);
}

static cube bounding_cube(const pags_gaussians *g) {
  double lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
  for (int64_t i = 0; i < g->count; i++) {
    if (!is_finite_mean(g, i))
      continue;
    for (int k = 0; k < 3; k++) {
      double x = pags_plane(g, PAGS_MEAN + k)[i];
      lo[k] = fmin(lo[k], x);
      hi[k] = fmax(hi[k], x);
    }
  }
  double extent = fmax(hi[0] - lo[0], fmax(hi[1] - lo[1], hi[2] - lo[2]));
  return (cube){{lo[0], lo[1], lo[2]}, extent > 0 ? (double)(1 << AXIS_BITS) / extent : 0};
}

/* Moves bit k of the 21 low bits of x to bit 3 k. */
static uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001F00000000FFFFu;
  x = (x | x << 16) & 0x001F0000FF0000FFu;
  x = (x | x << 8) & 0x100F00F00F00F00Fu;
  x = (x | x << 4) & 0x10C30C30C30C30C3u;
  return (x | x << 2) & 0x1249249249249249u;
}

/* Returns the Morton code of the mean of row i: the bits of its cell numbers along x, y and z interleaved. */
static uint64_t code_of(const pags_gaussians *g, int64_t i, const cube *box) {
  if (!is_finite_mean(g, i))
    return UINT64_MAX; /* larger than any code, which has 63 bits: such rows come last */
  uint64_t code = 0;
  for (int k = 0; k < 3; k++) {
    double cell = (pags_plane(g, PAGS_MEAN + k)[i] - box->lo[k]) * box->cells_per_metre;
    uint64_t whole = (uint64_t)fmin(cell, (double)((1 << AXIS_BITS) - 1));
    code |= spread(whole) << k;
  }
  return code;
}

/* One pass of the radix sort, stable, by the 11 bits of the code from bit `shift` on. Returns 0, having moved
 * nothing, if all rows have the same digit. */
static int scatter(const keyed_row *from, keyed_row *to, int64_t count, int shift) {
  int64_t start[DIGITS] = {0};
  for (int64_t i = 0; i < count; i++)
    ++start[from[i].code >> shift & (DIGITS - 1)];
  if (start[from[0].code >> shift & (DIGITS - 1)] == count)
    return 0;
  int64_t sum = 0;
  for (int d = 0; d < DIGITS; d++) {
    int64_t rows = start[d];
    start[d] = sum;
    sum += rows;
  }
  for (int64_t i = 0; i < count; i++)
    to[start[from[i].code >> shift & (DIGITS - 1)]++] = from[i];
  return 1;
}

pags_result pags_gaussians_morton_order(const pags_gaussians *g, int64_t *index) {
  if (g->count == 0)
    return PAGS_OK;
  keyed_row *block = calloc((size_t)g->count, 2 * sizeof *block);
  if (!block)
    return pags_out_of_memory("%lld Gaussians", (long long)g->count);
  keyed_row *rows = block, *other = block + g->count;
  cube box = bounding_cube(g);
  for (int64_t i = 0; i < g->count; i++)
    rows[i] = (keyed_row){code_of(g, i, &box), i};
  for (int pass = 0; pass < PASSES; pass++) {
    if (scatter(rows, other, g->count, pass * DIGIT_BITS)) {
      keyed_row *sorted = other;
      other = rows;
      rows = sorted;
    }
  }
  for (int64_t i = 0; i < g->count; i++)
    index[i] = rows[i].row;
  free(block);
  return PAGS_OK;
}

pags_result pags_gaussians_sorted_copy(pags_gaussians *out, const pags_gaussians *from) {
  *out = (pags_gaussians){0};
  int64_t *index = malloc(((size_t)from->count + 1) * sizeof *index);
  if (!index)
    return pags_out_of_memory("%lld Gaussians", (long long)from->count);
  pags_result result = pags_gaussians_morton_order(from, index);
  if (result == PAGS_OK)
    result = pags_gaussians_create_like(out, from->count, from);
  if (result == PAGS_OK)
    pags_gaussians_gather(from, index, from->count, out);
  free(index);
  return result;
}
