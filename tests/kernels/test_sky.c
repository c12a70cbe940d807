/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the sky kernels, which find each pixel's texel cell and blend its colour. Compares each ISA with the scalar
 * kernel (to the bit if the build allows that), and all with double. */
#include "check.h"

#include <math.h>
#include <string.h>

enum { STRIDE = 48, X0 = 32, Y0 = 160, PIXELS = PAGS_TILE_PIXELS, PLANE = 15 * STRIDE + 16 };

static const int sizes[] = {1, 2, 3, 4, 17, 64, 256};

typedef struct sky_case {
  pags_sky_rays rays;
  float *texels;
} sky_case;

/* Makes a camera with a field of view of about 60 degrees, or, if `wide`, one that sees four cube faces at once. */
static sky_case make_case(int size, bool wide) {
  sky_case s = {.rays = {.size = size}};
  double q[4], norm = 0.0;
  for (int k = 0; k < 4; k++)
    q[k] = (double)check_normal(), norm += q[k] * q[k];
  for (int k = 0; k < 4; k++)
    q[k] /= sqrt(norm);
  const double w = q[0], x = q[1], y = q[2], z = q[3], focal = wide ? 3.0 : 300.0, cx = X0 + 7.3, cy = Y0 + 9.1;
  const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                       2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  for (int k = 0; k < 3; k++) {
    s.rays.across[k] = (float)(r[3 * k] / focal), s.rays.downwards[k] = (float)(r[3 * k + 1] / focal);
    s.rays.forward[k] = (float)r[3 * k + 2];
  }
  s.rays.cx = (float)cx, s.rays.cy = (float)cy;
  const int64_t count = 18 * (int64_t)size * size;
  s.texels = CHECK_NEW(float, count);
  for (int64_t i = 0; i < count; i++)
    s.texels[i] = check_uniform(-0.2f, 1.2f);
  check_freeze(s.texels);
  return s;
}

/* The sky's colour of pixel i as pags/sky.h defines it. Returns the relative distance of the direction to the nearest
 * other face. */
static double sample(const sky_case *s, int i, double rgb[3]) {
  const double px = X0 + i % 16 + 0.5 - (double)s->rays.cx, py = Y0 + i / 16 + 0.5 - (double)s->rays.cy;
  double d[3], a[3];
  for (int k = 0; k < 3; k++) {
    d[k] = (double)s->rays.forward[k] + px * (double)s->rays.across[k] + py * (double)s->rays.downwards[k];
    a[k] = fabs(d[k]);
  }
  const int axis = a[0] >= a[1] && a[0] >= a[2] ? 0 : a[1] >= a[2] ? 1 : 2, face = 2 * axis + (d[axis] < 0.0);
  const double sc[6] = {-d[2], d[2], d[0], d[0], d[0], -d[0]}, tc[6] = {-d[1], -d[1], d[2], -d[2], -d[1], -d[1]};
  const int n = s->rays.size;
  double at[2] = {(sc[face] / a[axis] + 1) / 2 * n - 0.5, (tc[face] / a[axis] + 1) / 2 * n - 0.5};
  int first[2];
  for (int k = 0; k < 2; k++) {
    at[k] = fmin(fmax(at[k], 0.0), n - 1.0);
    first[k] = (int)at[k];
    at[k] -= first[k];
  }
  for (int c = 0; c < 3; c++) {
    rgb[c] = 0.0;
    for (int tap = 0; tap < 4; tap++) {
      const int column = first[0] + (tap & 1) < n ? first[0] + (tap & 1) : n - 1;
      const int row = first[1] + (tap >> 1) < n ? first[1] + (tap >> 1) : n - 1;
      const double weight = (tap & 1 ? at[0] : 1 - at[0]) * (tap >> 1 ? at[1] : 1 - at[1]);
      rgb[c] += weight * (double)s->texels[3 * ((face * n + row) * n + column) + c];
    }
  }
  return (a[axis] - fmax(a[(axis + 1) % 3], a[(axis + 2) % 3])) / a[axis];
}

typedef struct tile {
  float *plane[4]; /* red, green, blue, transmittance */
} tile;

static tile make_tile(void) {
  tile t;
  for (int c = 0; c < 4; c++) {
    t.plane[c] = CHECK_NEW(float, PLANE);
    for (int i = 0; i < PLANE; i++)
      t.plane[c][i] = check_uniform(c == 3 ? 1e-4f : 0.0f, 1.0f);
  }
  /* Some rows show no sky, or only at their last pixel. */
  for (int y = check_below(8); y < 16; y += 1 + check_below(8)) {
    const int zeros = 15 + check_below(2);
    for (int x = 0; x < zeros; x++)
      t.plane[3][y * STRIDE + x] = 0.0f;
  }
  return t;
}

static void blend(const pags_kernels *k, const sky_case *s, const tile *t) {
  pags_sky_tile *const found = CHECK_NEW(pags_sky_tile, 1);
  k->sky_find(&s->rays, s->texels, X0, Y0, found);
  check_freeze(found);
  k->sky_blend(&s->rays, s->texels, found, STRIDE, t->plane[3], t->plane);
}

static void check_colours(const sky_case *s, const tile *before, const tile *after, int *checked) {
  for (int i = 0; i < PIXELS; i++) {
    double rgb[3];
    if (sample(s, i, rgb) < 1e-5)
      continue;
    ++*checked;
    for (int c = 0; c < 3; c++) {
      const int64_t at = i / 16 * STRIDE + i % 16;
      const double want = (double)before->plane[c][at] + (double)before->plane[3][at] * rgb[c];
      /* Tolerance for the rounding of the position between texels. */
      if (!(fabs((double)after->plane[c][at] - want) <= 1e-6 * (2 + s->rays.size)))
        CHECK_FAIL("size %d, pixel %d, channel %d: %.9g, should be %.9g", s->rays.size, i, c,
                   (double)after->plane[c][at], want);
    }
  }
}

static void test_blend(const pags_kernels *k) {
  int checked = 0;
  for (int round = 0; round < 40; round++)
    for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++) {
      const sky_case s = make_case(sizes[n], round & 1);
      const tile before = make_tile();
      tile got = {{NULL}}, want = {{NULL}};
      for (int c = 0; c < 4; c++) {
        memcpy(got.plane[c] = CHECK_NEW(float, PLANE), before.plane[c], PLANE * sizeof(float));
        memcpy(want.plane[c] = CHECK_NEW(float, PLANE), before.plane[c], PLANE * sizeof(float));
      }
      check_freeze(got.plane[3]);
      blend(k, &s, &got);
      check_colours(&s, &before, &got, &checked);
      blend(&pags_kernels_scalar, &s, &want);
      for (int c = 0; c < 3; c++) {
        if (CHECK_EXACT)
          CHECK_SAME("blended", got.plane[c], want.plane[c], PLANE);
        for (int i = 0; i < PLANE; i++) /* the gaps between the tile's rows aren't written */
          CHECK(i % STRIDE < 16 || got.plane[c][i] == before.plane[c][i]);
      }
      check_release();
    }
  CHECK(checked > 40 * 7 * 250);
}

typedef struct cells {
  int32_t *row, *column;
  float *weight[4];
} cells;

static cells find_cells(const pags_kernels *k, const sky_case *s, int step) {
  const int count = (1 + 15 / step) * 16;
  cells c = {.row = CHECK_NEW(int32_t, count), .column = CHECK_NEW(int32_t, count)};
  for (int w = 0; w < 4; w++)
    c.weight[w] = CHECK_NEW(float, count);
  k->sky_cells(&s->rays, X0, Y0, step, c.row, c.column, c.weight);
  return c;
}

static void check_cell(const cells *c, int i, int size) {
  const int step = size > 1;
  float sum = 0.0f;
  for (int w = 0; w < 4; w++) {
    CHECK(c->weight[w][i] >= 0.0f && c->weight[w][i] <= 1.0f);
    sum += c->weight[w][i];
  }
  CHECK(fabsf(sum - 1.0f) < 1e-6f);
  CHECK(c->row[i] >= 0 && c->row[i] < 6 * size && c->column[i] >= 0);
  CHECK(c->column[i] + step < size && c->row[i] % size + step < size);
}

/* Cells lie within their face, and their texels and weights are those that blending uses. */
static void test_cells(const pags_kernels *k) {
  for (int round = 0; round < 40; round++)
    for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++) {
      const sky_case s = make_case(sizes[n], round & 1);
      const int size = sizes[n], right = size > 1, below = right * size, corner[4] = {0, right, below, below + right};
      tile t = make_tile();
      for (int c = 0; c < 4; c++)
        for (int i = 0; i < PLANE; i++)
          t.plane[c][i] = c == 3 ? 1.0f : 0.0f;
      const cells all = find_cells(k, &s, 1), some = find_cells(k, &s, 15);
      blend(k, &s, &t);
      for (int i = 0; i < PIXELS; i++) {
        check_cell(&all, i, size);
        for (int c = 0; c < 3; c++) {
          double want = 0.0;
          for (int w = 0; w < 4; w++)
            want +=
                (double)all.weight[w][i] * (double)s.texels[3 * (all.row[i] * size + all.column[i] + corner[w]) + c];
          CHECK(fabs((double)t.plane[c][i / 16 * STRIDE + i % 16] - want) <= 1e-6);
        }
      }
      for (int i = 0; i < 32; i++) {
        const int same = i / 16 * 240 + i % 16;
        CHECK(some.row[i] == all.row[same] && some.column[i] == all.column[same]);
        for (int w = 0; w < 4; w++)
          CHECK(some.weight[w][i] == all.weight[w][same]);
      }
      check_release();
    }
}

/* Non-finite and huge camera vectors must not lead to reads outside of the map. */
static void test_nonsense(const pags_kernels *k) {
  static const float values[] = {0.0f, NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e-40f};
  for (int round = 0; round < 500; round++) {
    sky_case s = make_case(sizes[check_below(5)], false);
    for (int v = 0; v < 9; v++)
      (v < 3 ? s.rays.forward : v < 6 ? s.rays.across : s.rays.downwards)[v % 3] = values[check_below(7)];
    const tile t = make_tile();
    const cells c = find_cells(k, &s, 1);
    blend(k, &s, &t);
    for (int i = 0; i < PIXELS; i++)
      check_cell(&c, i, s.rays.size);
    check_release();
  }
}

/* The cell whose last texel is the last of the map. */
static void test_last_cell(const pags_kernels *k) {
  for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++) {
    sky_case s = make_case(sizes[n], false);
    for (int j = 0; j < 3; j++)
      s.rays.across[j] = s.rays.downwards[j] = 0.0f;
    /* The face -Z, whose right is -x and down is -y. */
    s.rays.forward[0] = s.rays.forward[1] = s.rays.forward[2] = -1.0f;
    s.rays.forward[2] = -1.0001f;
    tile t = make_tile();
    for (int i = 0; i < PLANE; i++)
      t.plane[0][i] = t.plane[1][i] = t.plane[2][i] = 0.0f, t.plane[3][i] = 1.0f;
    blend(k, &s, &t);
    for (int c = 0; c < 3; c++)
      CHECK(fabsf(t.plane[c][0] - s.texels[18 * sizes[n] * sizes[n] - 3 + c]) < 1e-6f);
    check_release();
  }
}

enum { COLOURS = 48 };

typedef struct colours {
  float *colour, *first, *second;
} colours;

static colours make_colours(void) {
  const colours c = {CHECK_NEW(float, COLOURS), CHECK_NEW(float, COLOURS), CHECK_NEW(float, COLOURS)};
  return c;
}

/* Compares with the recurrence in double and, to the bit, with the scalar kernel. A colour that wasn't seen stays,
 * even if its gradient is NaN. */
static void test_adam(const pags_kernels *k) {
  for (int round = 0; round < 100; round++) {
    const colours got = make_colours(), want = make_colours();
    float *const gradient = CHECK_NEW(float, COLOURS), *const rate = CHECK_NEW(float, COLOURS),
                 *const correction = CHECK_NEW(float, COLOURS);
    for (int i = 0; i < COLOURS; i++) {
      const bool seen = check_below(3) > 0;
      got.colour[i] = want.colour[i] = check_uniform(0.0f, 1.0f);
      got.first[i] = want.first[i] = check_uniform(-1e-3f, 1e-3f);
      got.second[i] = want.second[i] = check_uniform(0.0f, 1e-6f);
      gradient[i] = seen ? check_uniform(-1e-2f, 1e-2f) : NAN;
      rate[i] = seen ? check_uniform(1e-4f, 1e-1f) : 0.0f;
      correction[i] = check_uniform(1.0f, 1000.0f);
    }
    const pags_sky_step step = {0.9f, 0.999f, 1e-15f, gradient, rate, correction};
    k->sky_adam(&step, COLOURS, got.colour, got.first, got.second);
    for (int i = 0; i < COLOURS; i++) {
      const double g = (double)gradient[i], m = 0.9 * (double)want.first[i] + 0.1 * g,
                   v = 0.999 * (double)want.second[i] + 0.001 * g * g;
      const double moved = (double)rate[i] * m / (sqrt(v * (double)correction[i]) + 1e-15);
      const double c = rate[i] > 0.0f ? (double)want.colour[i] - moved : (double)want.colour[i];
      CHECK(fabs((double)got.colour[i] - c) <= 1e-6 * (1.0 + fabs(c)));
      CHECK(rate[i] > 0.0f || (got.first[i] == want.first[i] && got.second[i] == want.second[i]));
    }
    pags_kernels_scalar.sky_adam(&step, COLOURS, want.colour, want.first, want.second);
    CHECK(memcmp(got.colour, want.colour, sizeof(float[COLOURS])) == 0);
    CHECK(memcmp(got.first, want.first, sizeof(float[COLOURS])) == 0);
    CHECK(memcmp(got.second, want.second, sizeof(float[COLOURS])) == 0);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  const sky_case s = make_case(256, false);
  const tile t = make_tile();
  const cells c = find_cells(k, &s, 1);
  CHECK_BENCH("sky_blend", PIXELS, "pixel") blend(k, &s, &t);
  CHECK_BENCH("sky_cells", PIXELS, "pixel") k->sky_cells(&s.rays, X0, Y0, 1, c.row, c.column, c.weight);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {{"sky blend", test_blend},         {"sky cells", test_cells},
                                     {"sky last cell", test_last_cell}, {"sky nonsense", test_nonsense},
                                     {"sky adam", test_adam},           {"sky bench", test_bench}};
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
