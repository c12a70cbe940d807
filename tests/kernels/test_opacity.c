/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the loss terms on a row's opacities. Compares each ISA with the scalar kernel, and with the formulas in
 * double. */
#include "check.h"

#include <math.h>
#include <string.h>

enum { CHOSEN = 5, UNKNOWN = 64 }; /* label masks, one with two labels and one with a single label */

typedef struct row_case {
  pags_opacity_row row;
  const float *before; /* the gradient before the call; the kernel adds to it */
  int padded;          /* pixels up to the end of the last SIMD lane */
} row_case;

/* Makes transmittances from 1e-7 to 1, and NaN beyond the row's end; the gradient already holds values. */
static row_case make_case(int width, bool masked, bool unsure) {
  row_case c = {.padded = (width + 15) / 16 * 16};
  float *const t = CHECK_NEW(float, c.padded), *const before = CHECK_NEW(float, c.padded);
  uint8_t *const labels = CHECK_NEW(uint8_t, c.padded), *const mask = CHECK_NEW(uint8_t, c.padded);
  for (int i = 0; i < c.padded; i++) {
    const float small = expf(check_uniform(-16.0f, 0.0f));
    t[i] = i >= width ? NAN : check_below(8) == 0 ? (float)check_below(2) : check_below(2) ? small : 1.0f - small;
    before[i] = check_normal();
    labels[i] = (uint8_t)check_u32();
    mask[i] = (uint8_t)(check_below(3) ? 1 + check_below(255) : 0);
  }
  c.before = before;
  check_freeze(t);
  check_freeze(before);
  check_freeze(labels);
  check_freeze(mask);
  c.row = (pags_opacity_row){.width = width,
                             .transmittance = t,
                             .labels = labels,
                             .mask = masked ? mask : NULL,
                             .chosen = CHOSEN,
                             .unknown = check_below(2) ? UNKNOWN : 0,
                             .unsure = unsure,
                             .scale = check_uniform(0.1f, 3.0f)};
  return c;
}

static double run(const pags_kernels *k, const row_case *c, float *gradient) {
  pags_opacity_row row = c->row;
  row.gradient = memcpy(gradient, c->before, (size_t)c->padded * sizeof *gradient);
  return k->opacity_row(&row);
}

/* Returns value and derivative of a pixel by the formula, except that 1 - T is rounded to float. */
static double value_of(const pags_opacity_row *row, int i, double *slope) {
  const float t = row->transmittance[i], argument = row->unsure || row->labels[i] & CHOSEN ? t : 1.0f - t;
  const float clamped = fminf(fmaxf(argument, 1e-6f), 1.0f - 1e-6f);
  const double x = (double)clamped, y = (double)(1.0f - clamped), in = clamped == argument ? 1.0 : 0.0;
  if (row->unsure && row->labels[i] & CHOSEN) {
    *slope = in * (log(y) - log(x));
    return -x * log(x) - y * log(y);
  }
  *slope = in * (row->unsure || row->labels[i] & CHOSEN ? -1.0 : 1.0) / x;
  return -log(x);
}

static void check_case_of(const pags_kernels *k, int width, bool masked, bool unsure) {
  const row_case c = make_case(width, masked, unsure);
  float *const got = CHECK_NEW(float, c.padded), *const scalar = CHECK_NEW(float, c.padded);
  const double sum = run(k, &c, got), scalar_sum = run(&pags_kernels_scalar, &c, scalar);
  double want = 0.0;
  for (int i = 0; i < c.padded; i++) {
    double slope;
    if (i >= width || (c.row.mask && !c.row.mask[i]) || c.row.labels[i] & c.row.unknown) {
      CHECK(got[i] == c.before[i]);
      continue;
    }
    want += value_of(&c.row, i, &slope);
    const double gradient = (double)c.before[i] + slope * (double)c.row.scale;
    if (!(fabs((double)got[i] - gradient) <=
          4e-7 * (1.0 + fabs((double)c.before[i]) + fabs(slope) * (double)c.row.scale)))
      CHECK_FAIL("width %d, pixel %d of T %.9g: slope %.9g, should be %.9g", width, i, (double)c.row.transmittance[i],
                 (double)got[i], gradient);
  }
  CHECK(fabs(sum - want) <= 1e-6 * want);
  CHECK_FLOATS("gradient", got, scalar, c.padded, .relative = 1e-6, .absolute = 4e-6);
  CHECK(!CHECK_EXACT || sum == scalar_sum);
  check_release();
}

static void check_rows(const pags_kernels *k, bool unsure) {
  for (int width = 1; width < 100; width++)
    check_case_of(k, width, width & 1, unsure);
  check_case_of(k, 960, false, unsure);
}
static void test_sure(const pags_kernels *k) {
  check_rows(k, false);
}
static void test_unsure(const pags_kernels *k) {
  check_rows(k, true);
}

static void test_bench(const pags_kernels *k) {
  const row_case sure = make_case(960, true, false), unsure = make_case(960, true, true);
  float *const gradient = CHECK_NEW(float, 960);
  CHECK_BENCH("opacity_row", 960, "pixel") run(k, &sure, gradient);
  CHECK_BENCH("opacity_row, unsure", 960, "pixel") run(k, &unsure, gradient);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"opacity sure", test_sure}, {"opacity unsure", test_unsure}, {"opacity bench", test_bench}};
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
