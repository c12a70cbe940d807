/* SPDX-License-Identifier: Apache-2.0 */
/* Tests a camera's vignette and response curve over a row of pixels. Compares each ISA with the scalar kernel, and
 * with a piecewise evaluation in double. */
#include "check.h"

#include <math.h>
#include <string.h>

enum { PIECES = PAGS_LIGHT_BENDS, WIDEST = 960 };

typedef struct row_case {
  pags_light_row row;
  double keyframes[4];  /* the vignette's factors at q = k/3 */
  double rises[PIECES]; /* the rises of the curve's pieces */
  float *by_shown[3];
  int padded; /* pixels up to the end of the last SIMD lane */
} row_case;

/* Makes values from -0.1 to 1.3, and NaN beyond the row's end. */
static row_case make_case(int width) {
  row_case c = {.padded = (width + 15) / 16 * 16};
  double sum = 0.0, before = 0.0;
  for (int k = 0; k < 4; k++)
    c.keyframes[k] = 1.1 - 0.25 * k + 0.1 * (double)check_uniform(-1.0f, 1.0f);
  for (int i = 0; i < PIECES; i++)
    sum += c.rises[i] = (double)check_uniform(0.5f, 2.0f);
  const float cx = check_uniform(0.3f, 0.7f) * (float)width, cy = 300.0f, down = check_uniform(-cy, cy);
  c.row = (pags_light_row){.width = width,
                           .cx = cx,
                           .y_squared = down * down,
                           .per_corner = 1.0f / (cx * cx + cy * cy),
                           .vignette = {(float)c.keyframes[0]}};
  for (int k = 1; k < 4; k++) {
    const double next = 3.0 * (c.keyframes[k] - c.keyframes[k - 1]);
    c.row.vignette[k] = (float)(next - before);
    before = next;
  }
  before = 1.0;
  for (int i = 0; i < PIECES; i++) {
    c.rises[i] /= sum;
    c.row.bends[i] = (float)(PIECES * c.rises[i] - before);
    before = PIECES * c.rises[i];
  }
  for (int k = 0; k < 3; k++) {
    float *const rgb = CHECK_NEW(float, c.padded);
    c.by_shown[k] = CHECK_NEW(float, c.padded);
    for (int i = 0; i < c.padded; i++) {
      rgb[i] = i < width ? check_uniform(-0.1f, 1.3f) : NAN;
      c.by_shown[k][i] = i < width ? check_normal() : NAN;
    }
    check_freeze(rgb);
    check_freeze(c.by_shown[k]);
    c.row.rgb[k] = rgb;
  }
  return c;
}

/* The curve at u. *piece: index of its piece, -1 outside of 0..1; *share: position within the piece. */
static double curve(const row_case *c, double u, int *piece, double *share) {
  double f = 0.0;
  *piece = -1;
  *share = 0.0;
  if (!(u > 0.0 && u < 1.0))
    return u;
  *piece = (int)(u * PIECES);
  *share = u * PIECES - *piece;
  for (int i = 0; i < *piece; i++)
    f += c->rises[i];
  return f + *share * c->rises[*piece];
}

static void run(const pags_kernels *k, const row_case *c, float *const planes[3], bool back, double *sums) {
  pags_light_row row = c->row;
  for (int i = 0; i < 3; i++)
    row.planes[i] = memcpy(planes[i], c->by_shown[i], (size_t)c->padded * sizeof *planes[i]);
  if (back)
    k->light_back(&row, sums, sums + 4);
  else
    k->light_row(&row);
}

static void check_case_of(const pags_kernels *k, int width) {
  const row_case c = make_case(width);
  float *shown[3], *by[3], *scalar[3];
  double got[4 + PIECES], plain[4 + PIECES], want[4 + PIECES] = {0.0}, size[4 + PIECES] = {0.0};
  for (int i = 0; i < 3; i++) {
    shown[i] = CHECK_NEW(float, c.padded);
    by[i] = CHECK_NEW(float, c.padded);
    scalar[i] = CHECK_NEW(float, c.padded);
  }
  run(k, &c, shown, false, NULL);
  run(&pags_kernels_scalar, &c, scalar, false, NULL);
  for (int i = 0; i < 3; i++)
    CHECK_FLOATS("shown", shown[i], scalar[i], width, .relative = 1e-6, .absolute = 1e-6);
  run(k, &c, by, true, got);
  run(&pags_kernels_scalar, &c, scalar, true, plain);
  for (int x = 0; x < width; x++) {
    const double right = x + 0.5 - (double)c.row.cx;
    const double q = (right * right + (double)c.row.y_squared) * (double)c.row.per_corner;
    const int ring = q < 2.0 / 3.0 ? (int)(3.0 * q) : 2;
    const double along = 3.0 * q - ring,
                 bright = c.keyframes[ring] + along * (c.keyframes[ring + 1] - c.keyframes[ring]);
    for (int i = 0; i < 3; i++) {
      const double value = (double)c.row.rgb[i][x], by_y = (double)c.by_shown[i][x];
      double share;
      int piece;
      const double f = curve(&c, bright * value, &piece, &share);
      const double slope = piece < 0 ? 1.0 : PIECES * c.rises[piece];
      const bool at_bend = fabs(bright * value * PIECES - rint(bright * value * PIECES)) < 1e-5;
      if (!(fabs((double)shown[i][x] - f) <= 2e-6))
        CHECK_FAIL("width %d, pixel %d: %.9g, should be %.9g", width, x, (double)shown[i][x], f);
      if (!at_bend && !(fabs((double)by[i][x] - by_y * slope * bright) <= 4e-6 * (1.0 + fabs(by_y))))
        CHECK_FAIL("width %d, pixel %d: gradient %.9g, should be %.9g", width, x, (double)by[i][x],
                   by_y * slope * bright);
      want[ring] += by_y * slope * value * (1.0 - along);
      want[ring + 1] += by_y * slope * value * along;
      for (int j = 0; piece >= 0 && j < PIECES; j++)
        want[4 + j] += by_y * ((j < piece ? 1.0 : j == piece ? share : 0.0) - f);
      for (int j = 0; j < 4 + PIECES; j++)
        size[j] += fabs(by_y) * (at_bend ? 1.0 : 1e-6);
    }
  }
  for (int j = 0; j < 4 + PIECES; j++) {
    if (!(fabs(got[j] - want[j]) <= 4.0 * size[j]))
      CHECK_FAIL("width %d, number %d of the light: %.9g, should be %.9g", width, j, got[j], want[j]);
    CHECK(!CHECK_EXACT || got[j] == plain[j]);
  }
  check_release();
}

static void test_rows(const pags_kernels *k) {
  for (int width = 1; width < 100; width++)
    check_case_of(k, width);
  check_case_of(k, WIDEST);
}

static void test_bench(const pags_kernels *k) {
  const row_case c = make_case(WIDEST);
  float *const planes[3] = {CHECK_NEW(float, WIDEST), CHECK_NEW(float, WIDEST), CHECK_NEW(float, WIDEST)};
  double sums[4 + PIECES];
  CHECK_BENCH("light_row", WIDEST, "pixel") run(k, &c, planes, false, NULL);
  CHECK_BENCH("light_back", WIDEST, "pixel") run(k, &c, planes, true, sums);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {{"light rows", test_rows}, {"light bench", test_bench}};
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
