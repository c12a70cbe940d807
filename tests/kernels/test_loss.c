/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the kernels of the training loss. Compares each ISA with the scalar kernel, and with SSIM computed pixel by
 * pixel in double. */
#include "check.h"

#include <math.h>
#include <string.h>

typedef struct picture {
  int width, height;
  int64_t stride;
  float *prediction, exposure[2];
  uint8_t *target, *mask; /* mask NULL: every pixel counts */
  uint8_t *emphasis;      /* only with a mask: a pixel counts 1 + gain * emphasis times */
} picture;

static const float gain = 0.37f;

typedef enum content { NOISE, NEAR, EQUAL, HUGE_VALUES, ABSURD } content;

/* A random picture; its padding beyond the width holds values that must not influence the results. */
static picture make_picture(int width, int height, bool masked, content what) {
  picture p = {.width = width, .height = height, .stride = (width + 15) / 16 * 16 + 16 * check_below(2)};
  p.prediction = CHECK_NEW(float, p.stride *height);
  p.exposure[0] = what == EQUAL ? 1.0f : check_uniform(0.8f, 1.2f);
  p.exposure[1] = what == EQUAL ? 0.0f : check_uniform(-0.05f, 0.05f);
  p.target = CHECK_NEW(uint8_t, p.stride *height);
  p.mask = masked ? CHECK_NEW(uint8_t, p.stride *height) : NULL;
  p.emphasis = masked ? CHECK_NEW(uint8_t, p.stride *height) : NULL;
  for (int64_t i = 0; i < p.stride * height; i++) {
    const bool inside = i % p.stride < width;
    p.target[i] = (uint8_t)check_u32();
    const float near = (float)p.target[i] / 255.0f;
    p.prediction[i] = !inside          ? NAN
                      : what == NOISE  ? check_uniform(-0.2f, 1.3f)
                      : what == NEAR   ? near + 0.05f * check_normal()
                      : what == EQUAL  ? (float)p.target[i] * (1.0f / 255.0f)
                      : what == ABSURD ? (check_below(9)   ? near
                                          : check_below(9) ? 1e30f * check_normal()
                                                           : NAN)
                                       : 1e4f * check_normal();
    if (masked) {
      p.mask[i] = (uint8_t)(!inside || check_below(4) ? 1 + check_below(255) : 0);
      p.emphasis[i] = (uint8_t)check_below(3);
    }
  }
  check_freeze(p.prediction);
  check_freeze(p.target);
  if (masked) {
    check_freeze(p.mask);
    check_freeze(p.emphasis);
  }
  return p;
}

typedef struct result {
  float *gradient;
  double l1, squared, ssim, more_l1, more_dssim, by_exposure[2];
} result;

static void run(const pags_kernels *k, const picture *p, int begin, int end, result *r) {
  const size_t bytes = (size_t)pags_loss_scratch(p->stride) * sizeof(float);
  double(*const sums)[PAGS_LOSS_SUMS] = check_buffer((size_t)(end - begin) * sizeof *sums);
  pags_loss_rows io = {.width = p->width,
                       .height = p->height,
                       .begin = begin,
                       .end = end,
                       .stride = p->stride,
                       .prediction = p->prediction,
                       .exposure = {p->exposure[0], p->exposure[1]},
                       .target = p->target,
                       .mask = p->mask,
                       .emphasis = p->emphasis,
                       .gain = gain,
                       .gradient = r->gradient,
                       .l1_scale = 0.8f,
                       .ssim_scale = -0.1f,
                       .scratch = check_buffer(bytes),
                       .sums = sums};
  memset(io.scratch, 0xFF, bytes); /* NaN, as if another picture had left it */
  k->loss_rows(&io);
  for (int row = 0; row < end - begin; row++) {
    r->l1 += sums[row][PAGS_LOSS_L1];
    r->squared += sums[row][PAGS_LOSS_SQUARED];
    r->ssim += sums[row][PAGS_LOSS_SSIM];
    r->more_l1 += sums[row][PAGS_LOSS_MORE_L1];
    r->more_dssim += sums[row][PAGS_LOSS_MORE_DSSIM];
    r->by_exposure[0] += sums[row][PAGS_LOSS_BY_GAIN];
    r->by_exposure[1] += sums[row][PAGS_LOSS_BY_OFFSET];
  }
}

/* Evaluates the loss in bands of `rows` rows. */
static result in_bands(const pags_kernels *k, const picture *p, int rows) {
  result r = {.gradient = CHECK_NEW(float, p->stride * p->height)};
  for (int begin = 0; begin < p->height; begin += rows)
    run(k, p, begin, begin + rows < p->height ? begin + rows : p->height, &r);
  return r;
}

static void check_sums(const result *got, const result *want, const picture *p, double share) {
  const double pixels = (double)p->width * p->height;
  CHECK(fabs(got->l1 - want->l1) <= share * fmax(want->l1, 1e-3 * pixels));
  CHECK(fabs(got->squared - want->squared) <= share * fmax(want->squared, 1e-3 * pixels));
  CHECK(fabs(got->ssim - want->ssim) <= share * pixels);
  CHECK(fabs(got->more_l1 - want->more_l1) <= share * fmax(want->more_l1, 1e-3 * pixels));
  CHECK(fabs(got->more_dssim - want->more_dssim) <= share * pixels);
  for (int i = 0; i < 2; i++)
    CHECK(fabs(got->by_exposure[i] - want->by_exposure[i]) <= share * pixels);
}

/* ---- Evaluation in double ---- */

/* The eleven weights of SSIM's window, exp(-d^2 / 4.5) scaled to a sum of 1. */
static void weights(double w[11]) {
  double sum = 0.0;
  for (int k = 0; k < 11; k++)
    sum += w[k] = exp(-(k - 5) * (k - 5) / 4.5);
  for (int k = 0; k < 11; k++)
    w[k] /= sum;
}

static bool counted(const picture *p, int x, int y) {
  return !p->mask || p->mask[y * p->stride + x] != 0;
}

static double more(const picture *p, int x, int y) {
  return p->emphasis ? (double)gain * p->emphasis[y * p->stride + x] : 0.0;
}

static double ssim_at(const picture *p, double *const planes[5], int x, int y) {
  double s[5] = {0.0}, w[11];
  weights(w);
  for (int v = y < 5 ? 0 : y - 5; v <= y + 5 && v < p->height; v++)
    for (int u = x < 5 ? 0 : x - 5; u <= x + 5 && u < p->width; u++)
      for (int j = 0; j < 5; j++)
        s[j] += w[u - x + 5] * w[v - y + 5] * planes[j][v * p->width + u];
  const double c1 = 1e-4, c2 = 9e-4, cross = s[0] * s[1], power = s[0] * s[0] + s[1] * s[1];
  return (2 * cross + c1) * (2 * (s[4] - cross) + c2) / ((power + c1) * (s[2] + s[3] - power + c2));
}

static void fill(const picture *p, double *const planes[5]) {
  for (int y = 0; y < p->height; y++)
    for (int x = 0; x < p->width; x++) {
      const int64_t at = y * p->stride + x;
      const double a = counted(p, x, y) ? (double)p->exposure[0] * (double)p->prediction[at] + (double)p->exposure[1]
                                        : 0.0,
                   b = counted(p, x, y) ? p->target[at] / 255.0 : 0.0;
      const double values[5] = {a, b, a * a, b * b, a * b};
      for (int j = 0; j < 5; j++)
        planes[j][y * p->width + x] = values[j];
    }
}

/* Returns the derivative of the weighted sum of SSIM by the prediction of one pixel: central differences over the
 * windows that contain the pixel. */
static double ssim_gradient(const picture *p, double *const planes[5], int x, int y) {
  const int at = y * p->width + x;
  const double a = planes[0][at], b = planes[1][at], step = 1e-4;
  double sum[2] = {0.0, 0.0};
  for (int side = 0; side < 2; side++) {
    const double moved = a + (side ? step : -step);
    planes[0][at] = moved, planes[2][at] = moved * moved, planes[4][at] = moved * b;
    for (int v = y - 5; v <= y + 5; v++)
      for (int u = x - 5; u <= x + 5; u++)
        if (u >= 0 && v >= 0 && u < p->width && v < p->height && counted(p, u, v))
          sum[side] += (1.0 + more(p, u, v)) * ssim_at(p, planes, u, v);
  }
  planes[0][at] = a, planes[2][at] = a * a, planes[4][at] = a * b;
  return (sum[1] - sum[0]) / (2.0 * step);
}

static void check_plainly(const picture *p, const result *got) {
  double *planes[5];
  for (int j = 0; j < 5; j++)
    planes[j] = CHECK_NEW(double, p->width * p->height);
  fill(p, planes);
  result want = {.l1 = 0.0};
  const double exposed_by = (double)p->exposure[0];
  for (int y = 0; y < p->height; y++)
    for (int x = 0; x < p->width; x++) {
      const double a = planes[0][y * p->width + x], b = planes[1][y * p->width + x], d = fmin(fmax(a, 0.0), 1.0) - b;
      want.l1 += fabs(a - b);
      want.squared += d * d;
      const double ssim = counted(p, x, y) ? ssim_at(p, planes, x, y) : 0.0;
      want.ssim += ssim;
      want.more_l1 += more(p, x, y) * fabs(a - b);
      /* The derivative by the exposure follows from the gradient by the prediction, which is checked below. */
      if (counted(p, x, y)) {
        const double g = (double)got->gradient[y * p->stride + x] / exposed_by;
        want.by_exposure[0] += g * (double)p->prediction[y * p->stride + x];
        want.by_exposure[1] += g;
      }
      want.more_dssim += counted(p, x, y) ? more(p, x, y) * (1.0 - ssim) : 0.0;
    }
  check_sums(got, &want, p, 2e-5);
  for (int sample = 0; sample < 6; sample++) {
    const int x = check_below(p->width), y = check_below(p->height);
    const double a = planes[0][y * p->width + x], b = planes[1][y * p->width + x];
    if (fabs(a - b) < 1e-6)
      continue;
    const double l1 = (a > b ? 0.8 : -0.8) * (1.0 + more(p, x, y)), ssim = -0.1 * ssim_gradient(p, planes, x, y);
    const double should = counted(p, x, y) ? exposed_by * ((double)(float)l1 + ssim) : 0.0,
                 is = (double)got->gradient[y * p->stride + x];
    if (!(fabs(is - should) <= 2e-4 * fmax(fabs(ssim), 0.1) + 1e-6))
      CHECK_FAIL("gradient at (%d, %d) of %d x %d: %.9g, should be %.9g", x, y, p->width, p->height, is, should);
  }
}

/* ---- Cases ---- */

static const int sizes[][2] = {{1, 1},   {1, 40},  {40, 1},  {5, 3},   {7, 8},   {9, 9},   {15, 12}, {16, 16},
                               {17, 11}, {31, 17}, {33, 24}, {63, 13}, {64, 10}, {65, 33}, {130, 21}};

static void check_padding(const picture *p, const float *gradient) {
  for (int64_t i = 0; i < p->stride * p->height; i++)
    if (i % p->stride >= p->width || !counted(p, (int)(i % p->stride), (int)(i / p->stride)))
      CHECK(gradient[i] == 0.0f);
}

static void check_all(const pags_kernels *k, content what, bool masked) {
  for (size_t n = 0; n < sizeof sizes / sizeof *sizes; n++) {
    const picture p = make_picture(sizes[n][0], sizes[n][1], masked, what);
    const result got = in_bands(k, &p, p.height), want = in_bands(&pags_kernels_scalar, &p, p.height);
    /* The L1 gradient's sign changes if a difference rounds to 0 or not. */
    CHECK_FLOATS("gradient", got.gradient, want.gradient, p.stride * p.height, .absolute = 2e-5, .relative = 2e-5,
                 .flips = 1e-3, .flip_size = 1.7);
    check_sums(&got, &want, &p, CHECK_EXACT ? 0.0 : 1e-6);
    check_padding(&p, got.gradient);
    static const int bands[] = {1, 2, 3, 5, 8, 16};
    for (size_t b = 0; b < sizeof bands / sizeof *bands; b++) {
      const result parts = in_bands(k, &p, bands[b]);
      CHECK_SAME("gradient in bands", parts.gradient, got.gradient, p.stride * p.height);
      check_sums(&parts, &got, &p, 1e-12);
      if (p.height > 24)
        break;
    }
    if (what == NOISE || what == NEAR)
      check_plainly(&p, &got);
    check_release();
  }
}

static void test_noise(const pags_kernels *k) {
  check_all(k, NOISE, false);
}
static void test_near(const pags_kernels *k) {
  check_all(k, NEAR, false);
}
static void test_masked(const pags_kernels *k) {
  check_all(k, NEAR, true);
}

/* A prediction equal to the target has the difference 0 and the SSIM 1. */
static void test_equal(const pags_kernels *k) {
  const picture p = make_picture(37, 29, false, EQUAL);
  const result r = in_bands(k, &p, p.height);
  CHECK(r.l1 <= 1e-7 * 37 * 29 && r.squared <= 1e-12 && fabs(r.ssim - 37 * 29) <= 1e-4);
  for (int64_t i = 0; i < p.stride * p.height; i++)
    CHECK(fabsf(r.gradient[i]) <= 0.8f + 1e-3f);
}

/* Huge predictions, as of diverging training, still give finite results. */
static void check_huge(const pags_kernels *k, content what) {
  const picture p = make_picture(37, 29, false, what);
  const result got = in_bands(k, &p, p.height), want = in_bands(&pags_kernels_scalar, &p, p.height);
  for (int64_t i = 0; i < p.stride * p.height; i++)
    CHECK(isfinite(got.gradient[i]) && fabsf(got.gradient[i]) < 10.0f);
  if (CHECK_EXACT)
    CHECK_SAME("gradient", got.gradient, want.gradient, p.stride * p.height);
  CHECK(isfinite(got.ssim) && isfinite(got.l1) && got.squared <= 37 * 29);
}
static void test_huge(const pags_kernels *k) {
  check_huge(k, HUGE_VALUES);
  check_huge(k, ABSURD);
}

static void test_bench(const pags_kernels *k) {
  const picture p = make_picture(640, 64, false, NEAR);
  result r = {.gradient = CHECK_NEW(float, p.stride *p.height)};
  pags_loss_rows io = {.width = p.width,
                       .height = p.height,
                       .end = p.height,
                       .stride = p.stride,
                       .prediction = p.prediction,
                       .exposure = {1.0f, 0.0f},
                       .target = p.target,
                       .gradient = r.gradient,
                       .l1_scale = 0.8f,
                       .ssim_scale = -0.1f,
                       .scratch = CHECK_NEW(float, pags_loss_scratch(p.stride)),
                       .sums = check_buffer((size_t)p.height * sizeof(double[PAGS_LOSS_SUMS]))};
  CHECK_BENCH("loss_rows", p.width * p.height, "pixel") k->loss_rows(&io);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"loss noise", test_noise}, {"loss near", test_near}, {"loss masked", test_masked},
      {"loss equal", test_equal}, {"loss huge", test_huge}, {"loss bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
