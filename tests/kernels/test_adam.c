/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the Adam kernels over parameter planes. Compares each ISA with the scalar kernel, and with Adam's published
 * recurrence in double. Scalar and fused builds differ only by rounding, as no threshold affects the results here. */
#include "check.h"

#include <math.h>
#include <string.h>

static const int counts[] = {0, 1, 7, 8, 9, 15, 16, 17, 48, 49, 63, 64, 65, 255, 256};

enum { STEPS = 40 };
static const double beta1 = 0.9, beta2 = 0.999;

typedef struct plane {
  float *p, *m, *v, *gradient;
  int rows, padded;
} plane;

/* Parameters of magnitude 1, gradients over many orders of magnitude; rows beyond the count hold zeros with NaN
 * gradients. */
static plane make_plane(int rows) {
  plane a = {.rows = rows, .padded = (rows + 15) / 16 * 16};
  a.p = CHECK_NEW(float, a.padded);
  a.m = CHECK_NEW(float, a.padded);
  a.v = CHECK_NEW(float, a.padded);
  a.gradient = CHECK_NEW(float, a.padded);
  for (int i = 0; i < a.padded; i++) {
    const float size = ldexpf(1.0f, -check_below(24));
    const bool fresh = check_below(5) == 0; /* a row without a step so far */
    a.p[i] = i < rows ? check_normal() : 0.0f;
    a.m[i] = i < rows && !fresh ? 0.3f * size * check_normal() : 0.0f;
    a.v[i] = i < rows && !fresh ? size * size * check_uniform(0.1f, 2.0f) : 0.0f;
    a.gradient[i] = i < rows ? size * check_normal() : NAN;
  }
  check_freeze(a.gradient);
  return a;
}

static plane copy_plane(const plane *from) {
  plane a = *from;
  float **const to[3] = {&a.p, &a.m, &a.v};
  for (int j = 0; j < 3; j++) {
    float *const fresh = CHECK_NEW(float, a.padded);
    memcpy(fresh, *to[j], (size_t)a.padded * sizeof *fresh);
    *to[j] = fresh;
  }
  return a;
}

/* The terms of the first moment may cancel, so that fused builds compare it with the double recurrence only. */
static void compare(const plane *got, const plane *want, double p_absolute) {
  CHECK_FLOATS("p", got->p, want->p, got->padded, .ulp = 1, .absolute = p_absolute);
  CHECK_FLOATS("v", got->v, want->v, got->padded, .ulp = 2, .relative = 1e-6);
  if (CHECK_EXACT)
    CHECK_SAME("m", got->m, want->m, got->padded);
  for (int i = got->rows; i < got->padded; i++)
    CHECK(got->p[i] == 0.0f && got->m[i] == 0.0f && got->v[i] == 0.0f);
}

static pags_adam_step step_at(int k, double rate, int since) {
  const double root = sqrt(1.0 - pow(beta2, k));
  return (pags_adam_step){.decay1 = (float)pow(beta1, since),
                          .decay2 = (float)pow(beta2, since),
                          .blend1 = (float)(1.0 - beta1),
                          .blend2 = (float)(1.0 - beta2),
                          .rate = (float)(rate * root / (1.0 - pow(beta1, k))),
                          .eps = (float)(1e-15 * root)};
}

static void test_update(const pags_kernels *k) {
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    plane got = make_plane(counts[n]), want = copy_plane(&got);
    const double rate = 1e-2;
    for (int t = 1; t <= 5; t++) {
      const pags_adam_step step = step_at(10 * t, rate, t == 3 ? 10 : 1);
      const plane before = copy_plane(&got);
      k->adam_update(got.p, got.m, got.v, got.gradient, got.rows, &step);
      pags_kernels_scalar.adam_update(want.p, want.m, want.v, want.gradient, want.rows, &step);
      compare(&got, &want, 1e-5 * rate);
      for (int i = 0; i < got.rows; i++) { /* one step of the recurrence in double */
        const double g = (double)got.gradient[i];
        const double m = (double)step.decay1 * (double)before.m[i] + (double)step.blend1 * g;
        const double v = (double)step.decay2 * (double)before.v[i] + (double)step.blend2 * g * g;
        const double p = (double)before.p[i] - (double)step.rate * m / (sqrt(v) + (double)step.eps);
        CHECK(fabs((double)got.m[i] - m) <= 1e-6 * (fabs((double)before.m[i]) + fabs(g)));
        CHECK(fabs((double)got.v[i] - v) <= 1e-6 * v);
        CHECK(fabs((double)got.p[i] - p) <= 1e-7 * (fabs(p) + 10.0 * rate));
      }
    }
    check_release();
  }
}

/* Tiny moments become zero, not denormal. A NaN gradient, which the caller has to prevent, affects only its row. */
static void test_small(const pags_kernels *k) {
  plane a = make_plane(16);
  float *const gradient = CHECK_NEW(float, 16);
  for (int i = 0; i < 16; i++) {
    gradient[i] = i == 5 ? NAN : 0.0f;
    a.m[i] = 1e-29f, a.v[i] = 1.01e-36f;
  }
  const pags_adam_step step = step_at(100, 1e-2, 60);
  k->adam_update(a.p, a.m, a.v, gradient, 16, &step);
  for (int i = 0; i < 16; i++)
    if (i != 5)
      CHECK(a.m[i] == 0.0f && a.v[i] == 0.0f && isfinite(a.p[i]));
}

/* Deferred steps applied one after another, each rounded: in one call, in two calls, and by the scalar kernel give
 * the same parameters. */
static void test_replay(const pags_kernels *k) {
  float weights[STEPS];
  for (int j = 0; j < STEPS; j++)
    weights[j] = 1e-2f * powf((float)(beta1 / sqrt(beta2)), (float)(j + 1));
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    plane got = make_plane(counts[n]), want = copy_plane(&got), pieces = copy_plane(&got);
    check_freeze(got.m);
    check_freeze(got.v);
    const plane before = copy_plane(&got);
    k->adam_replay(got.p, got.m, got.v, got.rows, weights, STEPS, 1e-15f);
    pags_kernels_scalar.adam_replay(want.p, want.m, want.v, want.rows, weights, STEPS, 1e-15f);
    compare(&got, &want, 1e-6);
    k->adam_replay(pieces.p, pieces.m, pieces.v, pieces.rows, weights, 0, 1e-15f);
    k->adam_replay(pieces.p, pieces.m, pieces.v, pieces.rows, weights, 13, 1e-15f);
    k->adam_replay(pieces.p, pieces.m, pieces.v, pieces.rows, weights + 13, STEPS - 13, 1e-15f);
    CHECK_SAME("p in pieces", pieces.p, got.p, got.padded);
    for (int i = 0; i < got.rows; i++) {
      double p = (double)before.p[i];
      for (int j = 0; j < STEPS; j++)
        p -= (double)weights[j] * (double)before.m[i] / (sqrt((double)before.v[i]) + 1e-15);
      CHECK(fabs((double)got.p[i] - p) <= 1e-7 * STEPS * (fabs(p) + 1.0));
    }
    check_release();
  }
}

/* Every kind of non-finite or too large number at every place of parameters and gradients sets its row's bit. Bits
 * that were set before stay. */
static void test_check(const pags_kernels *k) {
  static const float odd[] = {NAN, INFINITY, -INFINITY, 1e18f, 9.99e17f, 3.1e38f, 0.0f, -1e-40f};
  enum { PLANES = 7 };
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    const int rows = counts[n], padded = (rows + 15) / 16 * 16;
    float *const p = CHECK_NEW(float, PLANES *padded), *const g = CHECK_NEW(float, PLANES *padded);
    for (int choice = 0; choice < 4; choice++) {
      uint16_t got[16] = {0x8001}, want[16] = {0x8001};
      int any = 0;
      for (int i = 0; i < padded; i++) {
        bool bad = false;
        for (int j = 0; j < PLANES; j++) {
          float *const at = (choice & 1 ? p : g) + j * padded + i;
          p[j * padded + i] = check_normal(), g[j * padded + i] = i < rows ? check_normal() : NAN;
          if (check_below(choice < 2 ? 40 : 5) == 0)
            *at = odd[check_below(8)];
          bad |= !(fabsf(p[j * padded + i]) < 3e38f) || !(fabsf(g[j * padded + i]) < 1e18f);
        }
        if (bad && i < rows)
          want[i / 16] = (uint16_t)(want[i / 16] | 1u << i % 16), any = 1;
      }
      CHECK(k->adam_check(p, padded, g, padded, PLANES, rows, got) == any);
      CHECK(memcmp(got, want, sizeof got) == 0);
    }
    check_release();
  }
}

/* The range by adam_reach contains every row's final parameter, and some row or the range's initial value reaches
 * its ends. NaNs are ignored. */
static void test_reach(const pags_kernels *k) {
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    const plane a = make_plane(counts[n]);
    if (a.rows > 3)
      a.p[2] = NAN, a.m[3] = NAN;
    check_freeze(a.p);
    check_freeze(a.m);
    check_freeze(a.v);
    float got[2] = {0.25f, 0.5f}, want[2] = {0.25f, 0.5f};
    double plain[2] = {0.25, 0.5};
    k->adam_reach(a.p, a.m, a.v, a.rows, 0.05f, 1e-15f, got);
    pags_kernels_scalar.adam_reach(a.p, a.m, a.v, a.rows, 0.05f, 1e-15f, want);
    CHECK_FLOATS("reach", got, want, 2, .relative = 1e-6);
    for (int i = 0; i < a.rows; i++) {
      const double p = (double)a.p[i], end = p - (double)0.05f * (double)a.m[i] / (sqrt((double)a.v[i]) + 1e-15);
      if (isnan(end))
        continue;
      plain[0] = fmin(plain[0], fmin(p, end));
      plain[1] = fmax(plain[1], fmax(p, end));
    }
    for (int j = 0; j < 2; j++)
      CHECK(fabs((double)got[j] - plain[j]) <= 1e-6 * fabs(plain[j]));
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  const plane a = make_plane(256);
  float weights[STEPS] = {0.0f}, range[2] = {0.0f, 0.0f};
  const pags_adam_step step = step_at(100, 0.0, 1);
  CHECK_BENCH("adam_update", a.rows, "row") k->adam_update(a.p, a.m, a.v, a.gradient, a.rows, &step);
  enum { MANY = 59 }; /* parameter planes, of 64 rows each as in a cluster */
  float *const planes = CHECK_NEW(float, MANY * 64), *const gradients = CHECK_NEW(float, MANY * 64);
  uint16_t bad[16] = {0};
  CHECK_BENCH("adam_check, 59 planes", 64 * MANY, "row and plane")
  k->adam_check(planes, 64, gradients, 64, MANY, 64, bad);
  CHECK_BENCH("adam_replay, 40 steps", a.rows * STEPS, "row step")
  k->adam_replay(a.p, a.m, a.v, a.rows, weights, STEPS, 1e-15f);
  CHECK_BENCH("adam_reach", a.rows, "row") k->adam_reach(a.p, a.m, a.v, a.rows, 0.05f, 1e-15f, range);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"adam_update", test_update}, {"adam small moments", test_small}, {"adam_replay", test_replay},
      {"adam_reach", test_reach},   {"adam_check", test_check},         {"adam bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
