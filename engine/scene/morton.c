/* SPDX-License-Identifier: Apache-2.0 */
/* The order of Gaussians along a Morton curve (Morton 1966), by a radix sort of 63-bit codes: Gaussians that are
 * neighbours in memory are then neighbours in space, so that the bounds of clusters are small. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <pags/gaussians.h>

#include "base/memory.h"
#include "scene/morton.h"

enum { AXIS_BITS = 21, DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS, PASSES = 6 }; /* 6 digits of 11 bits hold a code */

typedef struct keyed_row {
  uint64_t code;
  int64_t row;
} keyed_row;

static bool is_finite_mean(const pags_gaussians *g, int64_t i) {
  return isfinite(pags_plane(g, PAGS_MEAN)[i]) && isfinite(pags_plane(g, PAGS_MEAN + 1)[i]) &&
         isfinite(pags_plane(g, PAGS_MEAN + 2)[i]);
}

pags_morton_cube pags_morton_bounds(const pags_gaussians *g) {
  pags_morton_cube box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
  for (int64_t i = 0; i < g->count; i++) {
    if (!is_finite_mean(g, i))
      continue;
    for (int k = 0; k < 3; k++) {
      double x = pags_plane(g, PAGS_MEAN + k)[i];
      box.lo[k] = fmin(box.lo[k], x);
      box.hi[k] = fmax(box.hi[k], x);
    }
  }
  return box;
}

/* ---- Boxes without stray rows ---- */

enum { PARTS = PAGS_MORTON_COUNTS / 3, PART_SHIFT = 21 };

/* The parts of an axis are those of all floats by sign, exponent and two bits of the mantissa, in ascending order. */
static int part_of(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return (int)((bits & 0x80000000u ? ~bits : bits | 0x80000000u) >> PART_SHIFT);
}

/* The least number of a part. */
static double part_begin(int part) {
  const uint32_t bits = (uint32_t)part << PART_SHIFT;
  const uint32_t number = bits & 0x80000000u ? bits & 0x7FFFFFFFu : ~bits;
  float x;
  memcpy(&x, &number, sizeof x);
  return (double)x;
}

static double extent_of(const pags_morton_cube *box) {
  return fmax(box->hi[0] - box->lo[0], fmax(box->hi[1] - box->lo[1], box->hi[2] - box->lo[2]));
}

bool pags_morton_is_wide(const pags_morton_cube *bounds) {
  return extent_of(bounds) > 16384; /* cells of 8 mm or more */
}

void pags_morton_count(const pags_gaussians *g, int64_t counts[PAGS_MORTON_COUNTS]) {
  for (int64_t i = 0; i < g->count; i++)
    for (int k = 0; k < 3 && is_finite_mean(g, i); k++)
      counts[k * PARTS + part_of(pags_plane(g, PAGS_MEAN + k)[i])]++;
}

void pags_morton_tighten(const int64_t counts[PAGS_MORTON_COUNTS], pags_morton_cube *bounds) {
  double lo[3], hi[3], core = 0;
  int64_t all = 0;
  for (int part = 0; part < PARTS; part++)
    all += counts[part];
  for (int k = 0; k < 3; k++) { /* all but a 32nd of the rows on either side */
    const int64_t *const axis = counts + k * PARTS;
    int first = 0, last = PARTS - 1;
    for (int64_t left = all / 32 - axis[0]; left >= 0 && first < last; left -= axis[first])
      first++;
    for (int64_t left = all / 32 - axis[last]; left >= 0 && first < last; left -= axis[last])
      last--;
    lo[k] = fmax(part_begin(first), bounds->lo[k]);
    hi[k] = last + 1 < PARTS ? fmin(part_begin(last + 1), bounds->hi[k]) : bounds->hi[k];
    core = fmax(core, hi[k] - lo[k]);
  }
  if (!(extent_of(bounds) > 4096 * core)) /* at least 512 cells across them all */
    return;
  for (int k = 0; k < 3; k++) {
    bounds->lo[k] = fmax(bounds->lo[k], lo[k] - 16 * core);
    bounds->hi[k] = fmin(bounds->hi[k], hi[k] + 16 * core);
  }
}

/* ---- Codes ---- */

/* Moves bit k of the 21 low bits of x to bit 3 k. */
static uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001F00000000FFFFu;
  x = (x | x << 16) & 0x001F0000FF0000FFu;
  x = (x | x << 8) & 0x100F00F00F00F00Fu;
  x = (x | x << 4) & 0x10C30C30C30C30C3u;
  return (x | x << 2) & 0x1249249249249249u;
}

/* The bits of the cell numbers along x, y and z interleaved, of 2^21 cells along each side of a cube: a cube rather
 * than the box, so that the cells are cubes whatever the shape of the scene. */
uint64_t pags_morton_code(const pags_gaussians *g, int64_t i, const pags_morton_cube *box) {
  if (!is_finite_mean(g, i))
    return UINT64_MAX; /* larger than any code, which has 63 bits: such rows come last */
  const double *const lo = box->lo;
  const double extent = extent_of(box);
  const double cells_per_metre = extent > 0 ? (double)(1 << AXIS_BITS) / extent : 0;
  uint64_t code = 0;
  for (int k = 0; k < 3; k++) {
    double cell = (pags_plane(g, PAGS_MEAN + k)[i] - lo[k]) * cells_per_metre;
    uint64_t whole = (uint64_t)fmin(fmax(cell, 0), (double)((1 << AXIS_BITS) - 1));
    code |= spread(whole) << k;
  }
  return code;
}

/* ---- Sorting ---- */

enum { BLOCK = 1 << 14 }; /* rows of a worker's block */

/* A stable radix sort in blocks: each block counts its rows by digit; prefix sums over (digit, block) give each block
 * its range for each digit; each block then moves its rows there. */
typedef struct sorting {
  const pags_gaussians *gaussians;
  pags_tasks *tasks;
  pags_morton_cube box;
  int64_t count, blocks;
  keyed_row *rows, *other;
  int64_t (*place)[DIGITS]; /* per block */
  int shift;                /* of the pass: the digit's lowest bit */
  int64_t *index;
} sorting;

static bool run_blocks(sorting *s, pags_block_fn *fn) {
  if (s->tasks)
    return pags_parallel_for(s->tasks, s->count, BLOCK, fn, s);
  for (int64_t begin = 0; begin < s->count; begin += BLOCK)
    fn(s, begin, begin + BLOCK < s->count ? begin + BLOCK : s->count, 0);
  return true;
}

static int digit_of(const sorting *s, int64_t row) {
  return (int)(s->rows[row].code >> s->shift & (DIGITS - 1));
}

static void make_codes(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sorting *const s = context;
  for (int64_t i = begin; i < end; i++)
    s->rows[i] = (keyed_row){pags_morton_code(s->gaussians, i, &s->box), i};
}

static void count_digits(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sorting *const s = context;
  int64_t *const place = s->place[begin / BLOCK];
  for (int d = 0; d < DIGITS; d++)
    place[d] = 0;
  for (int64_t i = begin; i < end; i++)
    place[digit_of(s, i)]++;
}

static void move_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sorting *const s = context;
  int64_t *const place = s->place[begin / BLOCK];
  for (int64_t i = begin; i < end; i++)
    s->other[place[digit_of(s, i)]++] = s->rows[i];
}

static void write_index(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const sorting *const s = context;
  for (int64_t i = begin; i < end; i++)
    s->index[i] = s->rows[i].row;
}

/* One pass, by the 11 bits of the code from bit `shift` on. Moves nothing if all rows have the same digit. */
static bool sort_pass(sorting *s) {
  int64_t sum = 0, same = 0;
  if (!run_blocks(s, count_digits))
    return false;
  for (int64_t b = 0; b < s->blocks; b++)
    same += s->place[b][digit_of(s, 0)];
  if (same == s->count)
    return true;
  for (int d = 0; d < DIGITS; d++)
    for (int64_t b = 0; b < s->blocks; b++) {
      const int64_t rows = s->place[b][d];
      s->place[b][d] = sum;
      sum += rows;
    }
  if (!run_blocks(s, move_rows))
    return false;
  keyed_row *const sorted = s->other;
  s->other = s->rows;
  s->rows = sorted;
  return true;
}

pags_result pags_morton_order(const pags_gaussians *g, pags_tasks *tasks, int64_t *index) {
  if (g->count == 0)
    return PAGS_OK;
  sorting s = {.gaussians = g, .tasks = tasks, .count = g->count, .index = index};
  s.blocks = (g->count + BLOCK - 1) / BLOCK;
  s.box = pags_morton_bounds(g);
  const bool wide = pags_morton_is_wide(&s.box);
  PAGS_AUTOFREE keyed_row *block = calloc((size_t)g->count, 2 * sizeof *block);
  PAGS_AUTOFREE int64_t(*place)[DIGITS] = malloc((size_t)s.blocks * sizeof *place);
  PAGS_AUTOFREE int64_t *counts = wide ? calloc(PAGS_MORTON_COUNTS, sizeof *counts) : NULL;
  PAGS_CHECK_MEMORY(block && place && (counts || !wide), "%lld Gaussians", (long long)g->count);
  if (wide) {
    pags_morton_count(g, counts);
    pags_morton_tighten(counts, &s.box);
  }
  s.rows = block;
  s.other = block + g->count;
  s.place = place;
  bool going = run_blocks(&s, make_codes);
  for (int pass = 0; pass < PASSES && going; pass++) {
    s.shift = pass * DIGIT_BITS;
    going = sort_pass(&s);
  }
  return going && run_blocks(&s, write_index) ? PAGS_OK : pags_fail(PAGS_CANCELLED, "cancelled");
}

pags_result pags_gaussians_morton_order(const pags_gaussians *g, int64_t *index) {
  return pags_morton_order(g, NULL, index);
}

pags_result pags_gaussians_sorted_copy(pags_gaussians *out, const pags_gaussians *from) {
  *out = (pags_gaussians){0};
  PAGS_AUTOFREE int64_t *index = malloc(((size_t)from->count + 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)from->count);
  PAGS_TRY(pags_gaussians_morton_order(from, index));
  PAGS_TRY(pags_gaussians_create_like(out, from->count, from));
  pags_gaussians_gather(from, index, from->count, out);
  return PAGS_OK;
}
