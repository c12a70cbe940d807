/* SPDX-License-Identifier: Apache-2.0 */
/* The photometric training loss and its gradient are compared with a direct evaluation in double, and this with
 * finite differences, for every SIMD kernel table that the machine runs and for any number of threads. */
#include <pags/frame.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "port/port.h"
#include "simd/kernels.h"
#include "train/photometric_loss.h"

/* cmocka compares in float; this macro compares in double. */
#define assert_near(value, expected, tolerance) assert_true(fabs((value) - (expected)) <= (tolerance))

typedef struct pair {
  int width, height, stride;
  float *planes, *gradient;
  double exposure[6];
  uint8_t *rgb, *mask, *emphasis; /* emphasis: how often each pixel counts; NULL: once */
  pags_picture picture;
  pags_photo photo;
} pair;

/* Fills the prediction with colours, some outside of [0, 1], a flat part and a part that equals the target. The
 * padding holds `garbage`, which must not influence results. */
static void fill(pair *p, uint64_t seed, float garbage) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < p->height; y++)
      for (int x = 0; x < p->stride; x++) {
        const int64_t at = ((int64_t)c * p->height + y) * p->stride + x;
        const double noise = pags_rng_uniform(seed, 1, (uint64_t)at),
                     wave = 0.5 + 0.4 * sin(0.4 * x + c) * cos(0.3 * y);
        const uint8_t target = (uint8_t)(255.0 * (0.7 * wave + 0.3 * pags_rng_uniform(seed, 2, (uint64_t)at)));
        const int flat = x > 20 && x < 50 && y > 15 && y < 30, same = x < 12 && y < 12;
        p->rgb[at] = x < p->width ? (flat ? 128 : target) : 0;
        p->planes[at] = flat   ? 0.4f
                        : same ? (float)p->rgb[at] * (1.0f / 255.0f)
                               : (float)(1.3 * wave + 0.4 * noise - 0.3);
        if (x >= p->width)
          p->planes[at] = garbage;
        p->gradient[at] = -7.0f;
      }
}

static pair make_pair(int width, int height, uint64_t seed, int masked) {
  pair p = {.width = width, .height = height, .stride = (width + 15) / 16 * 16};
  const int64_t plane = (int64_t)p.stride * height;
  p.planes = calloc((size_t)(3 * plane), sizeof *p.planes);
  p.gradient = calloc((size_t)(3 * plane), sizeof *p.gradient);
  p.rgb = calloc((size_t)(3 * plane), 1);
  fill(&p, seed, 1e30f);
  if (masked) {
    p.mask = calloc((size_t)plane, 1);
    for (int y = 0; y < height; y++)
      for (int x = 0; x < width; x++)
        p.mask[(int64_t)y * p.stride + x] = (x - 20) * (x - 20) + (y - 14) * (y - 14) > 80 && x < width - 3 ? 255 : 0;
  }
  for (int c = 0; c < 3; c++)
    p.exposure[c] = 1.0;
  p.picture = (pags_picture){.width = width, .height = height, .stride = p.stride};
  for (int c = 0; c < 3; c++)
    p.picture.rgb[c] = p.planes + c * plane;
  p.photo = (pags_photo){.width = width, .height = height, .stride = p.stride, .rgb = p.rgb, .mask = p.mask};
  return p;
}

static void free_pair(pair *p) {
  free(p->planes);
  free(p->gradient);
  free(p->rgb);
  free(p->mask);
  free(p->emphasis);
}

static const double times = 2.75;

/* Emphasises an upright stripe, part of which the mask hides. */
static void emphasise(pair *p) {
  p->emphasis = calloc((size_t)p->stride * (size_t)p->height, 1);
  for (int y = 0; y < p->height; y++)
    for (int x = p->width / 3; x < p->width; x++)
      p->emphasis[(int64_t)y * p->stride + x] = x + y / 3 < 2 * p->width / 3;
}

static pags_result evaluate(pair *p, pags_tasks *tasks, double weight, pags_photometric_loss *out) {
  float *gradient[3];
  for (int c = 0; c < 3; c++)
    gradient[c] = p->gradient + (int64_t)c * p->height * p->stride;
  pags_comparison how = {.ssim_weight = weight, .emphasis = p->emphasis, .times = p->emphasis ? times : 1.0};
  memcpy(how.exposure, p->exposure, sizeof how.exposure);
  return pags_photometric_loss_evaluate(tasks, &p->picture, &p->photo, &how, gradient, out);
}

/* ------------------------------------------------------------------------------------------------ plain evaluation */

static void plain_blur(const double *in, double *out, int width, int height) {
  double w[11], sum = 0.0;
  for (int i = 0; i < 11; i++)
    sum += w[i] = exp(-(i - 5) * (i - 5) / 4.5);
  double *rows = calloc((size_t)(width * height), sizeof *rows);
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      for (int k = -5; k <= 5; k++)
        if (x + k >= 0 && x + k < width)
          rows[y * width + x] += w[k + 5] / sum * in[y * width + x + k];
  for (int i = 0; i < width * height; i++)
    out[i] = 0.0;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      for (int k = -5; k <= 5; k++)
        if (y + k >= 0 && y + k < height)
          out[y * width + x] += w[k + 5] / sum * rows[(y + k) * width + x];
  free(rows);
}

/* Sums of SSIM values: `once` over the pixels whose `use` isn't zero, `all` over all pixels times their `use`.
 * `derivative` receives the derivative of `all` by x. x and y are masked already. */
typedef struct plain_sums {
  double once, all;
} plain_sums;

static plain_sums plain_ssim(const double *x, const double *y, const double *use, int width, int height,
                             double *derivative) {
  const int n = width * height;
  double *m = calloc((size_t)(9 * n), sizeof *m);
  plain_sums total = {0};
  double *in = m + 5 * n, *d[3] = {m + 6 * n, m + 7 * n, m + 8 * n};
  for (int k = 0; k < 5; k++) {
    for (int i = 0; i < n; i++)
      in[i] = k == 0 ? x[i] : k == 1 ? y[i] : k == 2 ? x[i] * x[i] : k == 3 ? y[i] * y[i] : x[i] * y[i];
    plain_blur(in, m + k * n, width, height);
  }
  for (int i = 0; i < n; i++) {
    const double mx = m[i], my = m[n + i], vx = m[2 * n + i] - mx * mx, vy = m[3 * n + i] - my * my;
    const double a1 = 2 * mx * my + 1e-4, a2 = 2 * (m[4 * n + i] - mx * my) + 9e-4;
    const double b1 = mx * mx + my * my + 1e-4, b2 = vx + vy + 9e-4, s = a1 * a2 / (b1 * b2);
    const double on = use[i];
    total.once += on > 0.0 ? s : 0.0;
    total.all += on * s;
    d[0][i] = on * ((2 * my * (a2 - a1)) / (b1 * b2) - 2 * mx * s / b1 + 2 * mx * s / b2);
    d[1][i] = -on * s / b2;
    d[2][i] = on * 2 * a1 / (b1 * b2);
  }
  for (int k = 0; k < 3; k++)
    plain_blur(d[k], d[k], width, height);
  for (int i = 0; i < n; i++)
    derivative[i] = d[0][i] + 2 * x[i] * d[1][i] + y[i] * d[2][i];
  free(m);
  return total;
}

/* The whole loss; `gradient` receives its 3 * width * height derivatives by the prediction. */
static pags_photometric_loss plain_loss(const pair *p, double weight, double *gradient) {
  const int n = p->width * p->height;
  pags_photometric_loss out = {0};
  double *x = calloc((size_t)(3 * n), sizeof *x), *y = x + n, *ssim = x + 2 * n;
  double *use = calloc((size_t)n, sizeof *use), l1 = 0.0, all = 0.0, weighted = 0.0;
  for (int i = 0; i < n; i++) {
    const int64_t at = (i / p->width) * p->stride + i % p->width;
    use[i] = p->mask && !p->mask[at] ? 0.0 : p->emphasis && p->emphasis[at] ? times : 1.0;
    out.counted += use[i] > 0.0;
    all += 3.0 * use[i];
  }
  const double values = 3.0 * (double)out.counted;
  for (int c = 0; c < 3; c++) {
    for (int i = 0; i < n; i++) {
      const int64_t at = ((int64_t)c * p->height + i / p->width) * p->stride + i % p->width;
      x[i] = use[i] > 0.0 ? (double)p->planes[at] : 0.0;
      y[i] = use[i] > 0.0 ? p->rgb[at] / 255.0 : 0.0;
      out.l1 += fabs(x[i] - y[i]) / values;
      l1 += use[i] * fabs(x[i] - y[i]) / values;
      out.mse += pow(fmin(1.0, fmax(0.0, x[i])) - y[i], 2.0) / values;
    }
    const plain_sums sums = plain_ssim(x, y, use, p->width, p->height, ssim);
    out.ssim += sums.once / values;
    weighted += sums.all / values;
    for (int i = 0; i < n; i++) {
      /* Values that are equal up to the rounding of k/255 have a derivative of 0. */
      const double sign = fabs(x[i] - y[i]) < 1e-7 ? 0.0 : x[i] > y[i] ? 1.0 : -1.0;
      gradient[c * n + i] = use[i] > 0.0 ? ((1.0 - weight) * use[i] * sign - weight * ssim[i]) / values : 0.0;
    }
  }
  out.loss = (1.0 - weight) * l1 + weight * (out.counted ? all / values - weighted : 1.0);
  free(x);
  free(use);
  return out;
}

/* ------------------------------------------------------------------------------------------------ tests */

/* Returns the largest error of the gradient relative to its root mean square (which is taken as at least 1e-3 of a
 * pixel's L1 gradient, as it may vanish); also asserts that the gradient is zero in the padding. */
static double gradient_error(const pair *p, const double *expected) {
  double worst = 0.0, power = 0.0;
  const int n = p->width * p->height;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < p->height; y++)
      for (int x = 0; x < p->stride; x++) {
        const float g = p->gradient[((int64_t)c * p->height + y) * p->stride + x];
        if (x >= p->width) {
          assert_true(g == 0.0f);
          continue;
        }
        const double e = expected[c * n + y * p->width + x];
        if (e == 0.0)
          assert_true(g == 0.0f);
        worst = fmax(worst, fabs((double)g - e));
        power += e * e;
      }
  return worst / fmax(sqrt(power / (3.0 * n)), 1e-3 / (3.0 * n));
}

static void check_against_plain(int width, int height, int masked, int emphasised, double weight, pags_tasks *tasks) {
  pair p = make_pair(width, height, (uint64_t)(width * 1000 + height), masked);
  if (emphasised)
    emphasise(&p);
  double *expected = calloc((size_t)(3 * width * height), sizeof *expected);
  const pags_photometric_loss plain = plain_loss(&p, weight, expected);
  pags_photometric_loss loss = {0};
  assert_int_equal(evaluate(&p, tasks, weight, &loss), PAGS_OK);
  assert_int_equal(loss.counted, plain.counted);
  assert_near(loss.l1, plain.l1, 1e-6);
  assert_near(loss.mse, plain.mse, 1e-6);
  assert_near(loss.ssim, plain.ssim, 1e-5);
  assert_near(loss.loss, plain.loss, 3e-6);
  assert_true(gradient_error(&p, expected) < 2e-4);
  free(expected);
  free_pair(&p);
}

static void test_plain(void **state) {
  (void)state;
  static const char *const tables[] = {"scalar", "avx2", "avx512", "neon"};
  static const int sizes[][2] = {{96, 70}, {61, 131}, {1, 1}, {17, 3}, {5, 50}, {128, 49}};
  const char *forced = getenv("PAGS_CPU");
  char *kept = forced ? strdup(forced) : NULL;
  pags_tasks *tasks = pags_tasks_create(2);
  for (size_t t = 0; t < sizeof tables / sizeof *tables; t++) {
    if (!pags_kernels_named(tables[t]))
      continue;
    pags_port_set_environment("PAGS_CPU", tables[t]);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
      for (int masked = 0; masked < 2; masked++)
        if (!masked || sizes[i][0] > 50)
          check_against_plain(sizes[i][0], sizes[i][1], masked, i % 2 == 0, 0.2, tasks);
    for (int emphasised = 0; emphasised < 2; emphasised++) {
      check_against_plain(70, 50, 1, emphasised, 1.0, tasks);
      check_against_plain(70, 50, 1, emphasised, 0.0, tasks);
    }
  }
  pags_port_set_environment("PAGS_CPU", kept);
  free(kept);
  pags_tasks_destroy(tasks);
}

/* Finite differences of the directly evaluated loss give its directly evaluated gradient, on which the comparisons
 * above rely. */
static void test_finite_differences(void **state) {
  (void)state;
  pair p = make_pair(37, 29, 5, 1);
  emphasise(&p);
  const int n = p.width * p.height;
  double *gradient = calloc((size_t)(6 * n), sizeof *gradient), *unused = gradient + 3 * n;
  plain_loss(&p, 0.2, gradient);
  for (int k = 0; k < 300; k++) {
    const int i = (int)pags_rng_below(9, 0, (uint64_t)k, (uint64_t)(3 * n)), c = i / n;
    float *at = p.planes + ((int64_t)c * p.height + i % n / p.width) * p.stride + i % p.width;
    const float middle = *at, low = middle - 1.0f / 1024, high = middle + 1.0f / 1024;
    const double target = p.rgb[at - p.planes] / 255.0;
    if (fabs((double)middle - target) < 2e-3)
      continue; /* within 2e-3 of the target |x - y| isn't differentiable */
    *at = high;
    const double above = plain_loss(&p, 0.2, unused).loss;
    *at = low;
    const double below = plain_loss(&p, 0.2, unused).loss;
    *at = middle;
    assert_near((above - below) / ((double)high - (double)low), gradient[i], 2e-7);
  }
  free(gradient);
  free_pair(&p);
}

/* With an exposure the loss is that of a picture with the planes gain * x + offset. Gradients are by the planes'
 * values, the gains and the offsets. */
static void test_exposure(void **state) {
  (void)state;
  static const double value[6] = {1.2, 0.9, 1.05, 0.03, -0.02, 0.01};
  pair p = make_pair(75, 52, 6, 1);
  emphasise(&p);
  const int64_t plane = (int64_t)p.stride * p.height, count = 3 * plane;
  float *gradient = malloc((size_t)count * sizeof *gradient), *picture = malloc((size_t)count * sizeof *picture);
  pags_tasks *tasks = pags_tasks_create(2);
  pags_photometric_loss exposed, written;
  double by[6] = {0.0};
  memcpy(p.exposure, value, sizeof value);
  assert_int_equal(evaluate(&p, tasks, 0.2, &exposed), PAGS_OK);
  memcpy(gradient, p.gradient, (size_t)count * sizeof *gradient);
  memcpy(picture, p.planes, (size_t)count * sizeof *picture);
  for (int64_t i = 0; i < count; i++)
    p.planes[i] = (float)(value[i / plane] * (double)p.planes[i] + value[3 + i / plane]);
  for (int k = 0; k < 6; k++)
    p.exposure[k] = k < 3;
  assert_int_equal(evaluate(&p, tasks, 0.2, &written), PAGS_OK);
  assert_near(exposed.loss, written.loss, 1e-6); /* in flat parts the variance is rounding noise only */
  for (int64_t i = 0; i < count; i++) {
    /* The L1 gradient of a pixel is 8e-5, which sets the tolerance. */
    assert_near(gradient[i], value[i / plane] * (double)p.gradient[i], 1e-7);
    if (p.gradient[i] != 0.0f)
      by[i / plane] += (double)p.gradient[i] * (double)picture[i];
    by[3 + i / plane] += (double)p.gradient[i];
  }
  memcpy(p.planes, picture, (size_t)count * sizeof *picture);
  for (int k = 0; k < 6; k++) {
    const double step = 1e-3; /* over this step many signs of x - y change, each with little effect */
    pags_photometric_loss above, below;
    assert_near(exposed.by_exposure[k], by[k], 1e-6);
    memcpy(p.exposure, value, sizeof value);
    p.exposure[k] = value[k] + step;
    assert_int_equal(evaluate(&p, tasks, 0.2, &above), PAGS_OK);
    p.exposure[k] = value[k] - step;
    assert_int_equal(evaluate(&p, tasks, 0.2, &below), PAGS_OK);
    assert_near((above.loss - below.loss) / (2.0 * step), by[k], 2e-3);
  }
  pags_tasks_destroy(tasks);
  free(gradient);
  free(picture);
  free_pair(&p);
}

static void test_threads(void **state) {
  (void)state;
  pair p = make_pair(150, 333, 3, 1);
  emphasise(&p);
  /* Sums of rows differ so much in size that double rounds when they are added: another order would give other bits. */
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < p.height; y += 3)
      for (int x = 0; x < p.width; x++) {
        const int64_t at = ((int64_t)c * p.height + y) * p.stride + x;
        p.rgb[at] = 0;
        p.planes[at] = y % 21 ? 1e-9f * (float)(1 + (x * 7 + y) % 113) : 1e4f + (float)y;
        p.mask[(int64_t)y * p.stride + x] = 255;
      }
  const size_t bytes = (size_t)(3 * p.stride * p.height) * sizeof(float);
  float *first = malloc(bytes);
  pags_photometric_loss loss, first_loss = {0};
  static const int counts[] = {1,  2,  3, 4,
                               11, 32, 64}; /* with more than 11 threads there are more than the usual bands */
  for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
    const int threads = counts[i];
    pags_tasks *tasks = pags_tasks_create(threads);
    memset(&loss, 0, sizeof loss);
    assert_int_equal(evaluate(&p, tasks, 0.2, &loss), PAGS_OK);
    if (threads == 1) {
      memcpy(first, p.gradient, bytes);
      first_loss = loss;
    }
    assert_memory_equal(first, p.gradient, bytes);
    assert_memory_equal(&first_loss, &loss, sizeof loss);
    pags_tasks_destroy(tasks);
  }
  free(first);
  free_pair(&p);
}

/* Values of the prediction below the mask or in the padding have no influence. */
static void test_unseen_pixels(void **state) {
  (void)state;
  pair p = make_pair(90, 60, 4, 1);
  const size_t count = (size_t)(3 * p.stride * p.height);
  float *first = malloc(count * sizeof *first);
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photometric_loss before = {0}, after = {0};
  assert_int_equal(evaluate(&p, tasks, 0.2, &before), PAGS_OK);
  memcpy(first, p.gradient, count * sizeof *first);
  for (size_t i = 0; i < count; i++)
    if (!p.mask[i % (count / 3)])
      p.planes[i] = i % 2 ? NAN : 1e20f;
  assert_int_equal(evaluate(&p, tasks, 0.2, &after), PAGS_OK);
  assert_memory_equal(first, p.gradient, count * sizeof *first);
  assert_true(before.loss == after.loss && before.mse == after.mse);
  assert_memory_equal(before.by_exposure, after.by_exposure, sizeof before.by_exposure);
  memset(p.mask, 0, count / 3);
  assert_int_equal(evaluate(&p, tasks, 0.2, &after), PAGS_OK);
  assert_true(after.loss == 0.0 && after.counted == 0);
  for (size_t i = 0; i < count; i++)
    assert_true(p.gradient[i] == 0.0f);
  free(first);
  free_pair(&p);
  pags_tasks_destroy(tasks);
}

/* For huge colours rounding must not give negative variances, and thereby huge SSIM values. */
static void test_huge_colours(void **state) {
  (void)state;
  pair p = make_pair(64, 40, 8, 0);
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photometric_loss loss = {0};
  for (int64_t i = 0; i < (int64_t)3 * p.stride * p.height; i++)
    p.planes[i] = 3e4f;
  assert_int_equal(evaluate(&p, tasks, 0.2, &loss), PAGS_OK);
  assert_true(fabs(loss.ssim) <= 1.0);
  for (int64_t i = 0; i < (int64_t)3 * p.stride * p.height; i++)
    assert_true(isfinite(p.gradient[i]));
  free_pair(&p);
  pags_tasks_destroy(tasks);
}

static void test_sizes_must_agree(void **state) {
  (void)state;
  pair p = make_pair(64, 40, 8, 0);
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photometric_loss loss = {0};
  p.photo.height--;
  assert_int_equal(evaluate(&p, tasks, 0.2, &loss), PAGS_ERROR_ARGUMENT);
  free_pair(&p);
  pags_tasks_destroy(tasks);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_plain),
      cmocka_unit_test(test_finite_differences),
      cmocka_unit_test(test_threads),
      cmocka_unit_test(test_unseen_pixels),
      cmocka_unit_test(test_exposure),
      cmocka_unit_test(test_huge_colours),
      cmocka_unit_test(test_sizes_must_agree),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
