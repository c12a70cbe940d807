/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the backward kernel, which turns gradient slots of splats into gradients of Gaussian parameters. Compares
 * each ISA with the scalar kernel (to the bit if the build allows that), and all with central differences of projection
 * and colour in double. */
#include "rows.h"

#include <math.h>
#include <string.h>

static const int counts[] = {0, 1, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256};

typedef struct frame {
  pags_projection view;
  rows rows;
  pags_splat *splats;
  uint32_t *keys;
  pags_tile_box *boxes;
  int64_t *slot_start, slot_count;
  float *slots;
  bool *poisoned; /* 1: a slot of this row holds a NaN or infinity that counts */
} frame;

static const pags_scan *scan; /* motion under a rolling shutter of the frames that are made; NULL: global shutter */

static frame make_frame(const pags_kernels *k, int count, row_kind kind, int degree, bool antialiased, bool poison) {
  frame f = {.view = view_random(degree, antialiased)};
  f.view.scan = scan;
  f.rows = rows_random(&f.view, count, kind);
  f.splats = CHECK_NEW(pags_splat, count);
  f.keys = CHECK_NEW(uint32_t, count);
  f.boxes = CHECK_NEW(pags_tile_box, count);
  f.slot_start = CHECK_NEW(int64_t, count);
  f.poisoned = CHECK_NEW(bool, count);
  k->project(&f.view, f.rows.data, f.rows.stride, NULL, count, f.splats, f.keys, false, f.boxes, NULL);
  k->shade(&f.view, f.rows.data, f.rows.stride, NULL, count, f.keys, f.splats);
  for (int i = 0; i < count; i++) {
    /* Rows that aren't drawn have no valid slot. */
    f.slot_start[i] = f.keys[i] == UINT32_MAX ? INT64_MAX / 2 : f.slot_count;
    f.poisoned[i] = false;
    if (f.keys[i] != UINT32_MAX)
      f.slot_count += f.splats[i].tiles = i >= 32 && i < 48 ? 0 : (uint32_t)check_below(5);
  }
  f.slots = CHECK_NEW(float, f.slot_count *PAGS_SLOT_FLOATS);
  for (int64_t s = 0; s < f.slot_count * PAGS_SLOT_FLOATS; s++)
    f.slots[s] = check_normal() * (s % PAGS_SLOT_FLOATS > PAGS_SLOT_Z ? 1.0f : 3.0f);
  for (int i = 0; i < count; i++)
    if (poison && f.keys[i] != UINT32_MAX && f.splats[i].tiles > 0 && check_below(6) == 0) {
      const int field = check_below(PAGS_SLOT_Z + 1);
      /* Gradients of channels clamped at 0 are ignored. */
      const bool colour = field >= PAGS_SLOT_R && field <= PAGS_SLOT_B;
      f.poisoned[i] = !colour || !(f.splats[i].clamped >> (field - PAGS_SLOT_R) & 1u);
      f.slots[f.slot_start[i] * PAGS_SLOT_FLOATS + field] = check_below(2) ? NAN : INFINITY;
    }
  check_freeze(f.splats);
  check_freeze(f.keys);
  check_freeze(f.slot_start);
  check_freeze(f.slots);
  return f;
}

typedef struct gradient {
  float *data, *mean2d, *radius;
  uint8_t *names;
  int64_t stride;
  int bad;
} gradient;

static gradient backward(const pags_kernels *k, const frame *f) {
  gradient g = {.stride = round_up_16(f->rows.count) + 16};
  const int64_t padded = round_up_16(f->rows.count);
  g.data = CHECK_NEW(float, (f->rows.planes - 1) * g.stride + padded);
  g.mean2d = CHECK_NEW(float, padded);
  g.radius = CHECK_NEW(float, padded);
  g.names = CHECK_NEW(uint8_t, padded);
  memset(g.names, 0, (size_t)padded);
  const pags_row_gradient out = {g.data, g.stride, g.mean2d, g.radius, g.names};
  g.bad = k->project_backward(&f->view, f->rows.data, f->rows.stride, NULL, f->rows.count, f->keys, f->splats,
                              f->slot_start, f->slots, &out);
  return g;
}

static bool has_gradient(const frame *f, int i) {
  return i < f->rows.count && f->keys[i] != UINT32_MAX && f->splats[i].tiles > 0;
}

/* Checks that the gradient is zero for rows that weren't drawn, up to the next multiple of 16, and finite everywhere,
 * and that the gap between planes isn't written. */
static void check_form(const frame *f, const gradient *g) {
  static const unsigned char untouched[4] = {0xA5, 0xA5, 0xA5, 0xA5};
  const int64_t padded = round_up_16(f->rows.count);
  for (int p = 0; p < f->rows.planes; p++) {
    for (int64_t i = 0; i < padded; i++)
      if (!isfinite(g->data[p * g->stride + i]) || (!has_gradient(f, (int)i) && g->data[p * g->stride + i] != 0.0f))
        CHECK_FAIL("row %lld, plane %d: %g", (long long)i, p, (double)g->data[p * g->stride + i]);
    for (int64_t i = padded; i < g->stride && p < f->rows.planes - 1; i++)
      CHECK(memcmp(g->data + p * g->stride + i, untouched, sizeof untouched) == 0);
  }
  for (int64_t i = 0; i < padded; i++)
    if (!has_gradient(f, (int)i))
      CHECK(g->mean2d[i] == 0.0f && g->radius[i] == 0.0f);
}

static void check_scalar(const frame *f, const gradient *got, const gradient *want) {
  if (!CHECK_EXACT)
    return;
  const int64_t padded = round_up_16(f->rows.count);
  CHECK(got->bad == want->bad);
  for (int p = 0; p < f->rows.planes; p++)
    CHECK_SAME("gradient", got->data + p * got->stride, want->data + p * want->stride, padded);
  CHECK_SAME("mean2d", got->mean2d, want->mean2d, padded);
  CHECK_SAME("radius", got->radius, want->radius, padded);
}

/* ---- Central differences ---- */

enum { TERMS = 10 }; /* x, y, B, C, D, ln opacity, z, r, g, b */

static void terms_of(const pags_projection *view, const double row[ROW_FLOATS], double terms[TERMS]) {
  const plain_row p = row_plainly(view, row);
  const double values[TERMS] = {p.x, p.y, p.b, p.c, p.d, log(p.opacity), p.z, p.rgb[0], p.rgb[1], p.rgb[2]};
  memcpy(terms, values, sizeof values);
}

/* Returns derivatives of the loss by each term, from the sums over the row's slots. */
static void weights_of(const frame *f, int i, const plain_row *p, double weights[TERMS],
                       double sums[PAGS_SLOT_FLOATS]) {
  const double ln2 = log(2.0), k = 0.5 / ln2, root_d = sqrt(p->d);
  for (int s = 0; s < PAGS_SLOT_FLOATS; s++) {
    sums[s] = 0.0;
    for (uint32_t t = 0; t < f->splats[i].tiles; t++)
      sums[s] += (double)f->slots[(f->slot_start[i] + t) * PAGS_SLOT_FLOATS + s];
  }
  const double P = sqrt(k * p->c / p->d), h = p->b / p->c, w = sqrt(k / p->c);
  weights[0] = 2.0 * ln2 * P * sums[PAGS_SLOT_SU];
  weights[1] = 2.0 * ln2 * (w * sums[PAGS_SLOT_SV] - P * h * sums[PAGS_SLOT_SU]);
  weights[2] = 2.0 * ln2 * sums[PAGS_SLOT_SUV] / root_d;
  weights[3] = ln2 * (sums[PAGS_SLOT_SVV] - sums[PAGS_SLOT_SUU]) / p->c - h * weights[2];
  weights[4] = ln2 * sums[PAGS_SLOT_SUU] / p->d;
  weights[5] = sums[PAGS_SLOT_S];
  weights[6] = sums[PAGS_SLOT_Z];
  for (int c = 0; c < 3; c++)
    weights[7 + c] = f->splats[i].clamped >> c & 1u ? 0.0 : sums[PAGS_SLOT_R + c];
}

static int group_of(int plane) {
  return plane < ROW_SCALE ? 0 : plane < ROW_QUATERNION ? 1 : plane < ROW_LOGIT ? 2 : plane < ROW_SH ? 3 : 4;
}

static void check_row(const frame *f, const gradient *g, int i, const double row[ROW_FLOATS]) {
  double weights[TERMS], sums[PAGS_SLOT_FLOATS], want[ROW_FLOATS], size[5] = {0.0};
  const plain_row p = row_plainly(&f->view, row);
  weights_of(f, i, &p, weights, sums);
  for (int plane = 0; plane < f->rows.planes; plane++) {
    double step = 1e-5, moved[ROW_FLOATS], up[TERMS], down[TERMS], total = 0.0;
    memcpy(moved, row, sizeof moved);
    if (plane < ROW_SCALE)
      step *= p.z;
    moved[plane] = row[plane] + step;
    terms_of(&f->view, moved, up);
    moved[plane] = row[plane] - step;
    terms_of(&f->view, moved, down);
    want[plane] = 0.0;
    for (int t = 0; t < TERMS; t++) {
      const double part = weights[t] * (up[t] - down[t]) / (2.0 * step);
      want[plane] += part;
      total += fabs(part);
    }
    size[group_of(plane)] = fmax(size[group_of(plane)], total);
  }
  for (int plane = 0; plane < f->rows.planes; plane++) {
    const double got = (double)g->data[plane * g->stride + i], bound = 1e-4 * size[group_of(plane)] + 1e-7;
    if (!(fabs(got - want[plane]) <= bound))
      CHECK_FAIL("row %d, plane %d: %.9g, should be %.9g to %.3g", i, plane, got, want[plane], bound);
  }
  const double ln2 = log(2.0), half_w = 0.5 * (double)f->view.width, half_h = 0.5 * (double)f->view.height;
  const double middle = 0.5 * (p.a + p.c), P = sqrt(0.5 / ln2 * p.c / p.d);
  const double others[2] = {hypot(weights[0] * half_w, weights[1] * half_h),
                            3.0 * sqrt(middle + sqrt(fmax(0.1, middle * middle - p.d)))};
  const float got[2] = {g->mean2d[i], g->radius[i]};
  const double terms = fabs(weights[0]) + 2.0 * ln2 * P * fabs(p.b / p.c * sums[PAGS_SLOT_SU]) * half_h;
  for (int j = 0; j < 2; j++)
    if (!(fabs((double)got[j] - others[j]) <= 1e-4 * others[j] + (j == 0 ? 1e-4 * terms : 1e-6)))
      CHECK_FAIL("row %d, statistic %d: %.9g, should be %.9g", i, j, (double)got[j], others[j]);
}

/* Returns whether central differences are valid for a row: not near the clamp of the Jacobian or the floor of the
 * compensation, and without extreme parameters. */
static bool differentiable(const pags_projection *v, const double row[ROW_FLOATS], int planes) {
  if (!row_usable(row, planes))
    return false;
  const plain_row p = row_plainly(v, row);
  const double dx = (p.x - (double)v->cx) / (double)v->fx, dy = (p.y - (double)v->cy) / (double)v->fy;
  const double edges[4] = {dx - (double)v->lim_x0, dx - (double)v->lim_x1, dy - (double)v->lim_y0,
                           dy - (double)v->lim_y1};
  for (int e = 0; e < 4; e++)
    if (fabs(edges[e]) < 1e-3)
      return false;
  for (int k = 0; k < planes; k++)
    if (fabs(row[k]) > 80.0 || (k == ROW_LOGIT && fabs(row[k]) > 15.0))
      return false;
  double q2 = 0.0;
  for (int k = 0; k < 4; k++)
    q2 += row[ROW_QUATERNION + k] * row[ROW_QUATERNION + k];
  return p.drawn && p.certain && q2 > 0.01 && p.a * p.c < 1e4 * p.d && p.d0 > 1e-3 * p.d;
}

static void check_kind(const pags_kernels *k, row_kind kind, bool poison) {
  int checked = 0, poisoned = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int choice = 0; choice < 4; choice++) {
      const frame f = make_frame(k, counts[n], kind, choice, choice & 1, poison);
      const gradient got = backward(k, &f), want = backward(&pags_kernels_scalar, &f);
      check_form(&f, &got);
      check_scalar(&f, &got, &want);
      int bad = 0;
      for (int i = 0; i < f.rows.count; i++) {
        double row[ROW_FLOATS];
        row_read(&f.rows, i, row);
        bad += has_gradient(&f, i) && f.poisoned[i];
        if (kind == ROWS_ORDINARY)
          CHECK((got.names[i] > 0) == (has_gradient(&f, i) && f.poisoned[i]) && got.names[i] <= f.rows.planes &&
                got.names[i] == want.names[i]);
        if (has_gradient(&f, i) && f.poisoned[i])
          CHECK(got.data[i] == 0.0f && got.data[ROW_SH * got.stride + i] == 0.0f && got.mean2d[i] == 0.0f);
        else if (has_gradient(&f, i) && !poison && differentiable(&f.view, row, f.rows.planes))
          check_row(&f, &got, i, row), checked++;
      }
      if (kind == ROWS_ORDINARY)
        CHECK(got.bad == bad);
      poisoned += bad;
      check_release();
    }
  check_note("%d rows against differences, %d with slots that aren't numbers", checked, poisoned);
  CHECK(poison ? poisoned > 50 : checked > (kind == ROWS_ORDINARY ? 400 : 100));
}

static void test_ordinary(const pags_kernels *k) {
  check_kind(k, ROWS_ORDINARY, false);
}
static void test_awkward(const pags_kernels *k) {
  check_kind(k, ROWS_AWKWARD, false);
}
static void test_needles(const pags_kernels *k) {
  check_kind(k, ROWS_NEEDLES, false);
}
static void test_poison(const pags_kernels *k) {
  check_kind(k, ROWS_ORDINARY, true);
}

/* With a rolling shutter every machine gives the scalar kernel's bits. tests/unit/frame/test_shutter.c compares the
 * values with differences of the oracle. */
static void test_rolling(const pags_kernels *k) {
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int kind = ROWS_ORDINARY; kind <= ROWS_AWKWARD; kind++) {
      const pags_projection view = view_random(0, false);
      const pags_scan own = scan_random(&view);
      scan = &own;
      const frame f = make_frame(k, counts[n], (row_kind)kind, check_below(4), n % 2, kind == ROWS_ORDINARY && n % 2);
      const gradient got = backward(k, &f), want = backward(&pags_kernels_scalar, &f);
      check_form(&f, &got);
      check_scalar(&f, &got, &want);
      check_release();
    }
  scan = NULL;
}

static void test_bench(const pags_kernels *k) {
  const frame f = make_frame(k, 256, ROWS_ORDINARY, 3, false, false);
  const gradient g = backward(k, &f);
  const pags_row_gradient out = {g.data, g.stride, g.mean2d, g.radius, NULL};
  CHECK_BENCH("project_backward", f.rows.count, "row")
  k->project_backward(&f.view, f.rows.data, f.rows.stride, NULL, f.rows.count, f.keys, f.splats, f.slot_start, f.slots,
                      &out);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"project_backward ordinary", test_ordinary}, {"project_backward awkward", test_awkward},
      {"project_backward needles", test_needles},   {"project_backward poison", test_poison},
      {"project_backward bench", test_bench},       {"project_backward rolling", test_rolling},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
