/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the loss terms of driving scenes (sky, objects, depth): values computed by hand, gradients compared with
 * finite differences of the same formulas in double, and the same bits for any number of threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>
#include <math.h>

#include "base/sort.h"
#include "train/driving_losses.h"

enum { WIDTH = 101, HEIGHT = 37, STRIDE = 112, PLANE = STRIDE * HEIGHT };

typedef struct fixture {
  pags_picture picture;
  pags_photo photo;
  float transmittance[PLANE], depth_sum[PLANE];
  uint8_t labels[PLANE], mask[PLANE];
  float by_transmittance[PLANE], by_depth_sum[PLANE];
} fixture;

static uint64_t random_state;
static double uniform(double lo, double hi) { /* splitmix64 */
  uint64_t z = random_state += 0x9E3779B97F4A7C15u;
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
  z = (z ^ z >> 27) * 0x94D049BB133111EBu;
  return lo + (hi - lo) * (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

/* Random transmittances down to 1e-7, a tenth of them exactly 1; the gradient planes already hold values, to which
 * the terms must add; the padding holds NaN. */
static fixture *create(uint64_t seed, int masked) {
  fixture *const f = calloc(1, sizeof *f);
  assert_non_null(f);
  random_state = seed;
  f->picture = (pags_picture){.width = WIDTH, .height = HEIGHT, .stride = STRIDE};
  f->picture.transmittance = f->transmittance, f->picture.depth_sum = f->depth_sum;
  f->photo = (pags_photo){.width = WIDTH, .height = HEIGHT, .stride = STRIDE, .labels = f->labels};
  f->photo.mask = masked ? f->mask : NULL;
  for (int i = 0; i < PLANE; i++) {
    const double t = uniform(0, 1) < 0.5 ? uniform(0, 1) : exp(uniform(log(1e-7), 0));
    f->transmittance[i] = i % STRIDE >= WIDTH ? NAN : uniform(0, 1) < 0.1 ? 1.0f : (float)t;
    f->depth_sum[i] = (float)uniform(0, 60);
    f->labels[i] = (uint8_t)uniform(0, 128);
    f->mask[i] = uniform(0, 1) < 0.7 ? 255 : 0;
    f->by_transmittance[i] = (float)uniform(-1e-6, 1e-6);
  }
  return f;
}

static int counts(const fixture *f, int i) {
  return i % STRIDE < WIDTH && (!f->photo.mask || f->mask[i]);
}

static int64_t count_pixels(const fixture *f) {
  int64_t n = 0;
  for (int i = 0; i < PLANE; i++)
    n += counts(f, i);
  return n;
}

/* Returns the term of one pixel by its definition, as a function of the transmittance t. */
static double sky_pixel(uint8_t labels, double t) {
  const double alpha = fmin(fmax(1 - t, 1e-6), 1 - 1e-6), wanted = labels & PAGS_LABEL_SKY ? 0 : 1;
  return -wanted * log(alpha) - (1 - wanted) * log(1 - alpha);
}
static double objects_pixel(uint8_t labels, double t) {
  const double alpha = fmin(fmax(1 - t, 1e-6), 1 - 1e-6);
  const int in_box = (labels & (PAGS_LABEL_VEHICLE | PAGS_LABEL_PEDESTRIAN | PAGS_LABEL_CYCLIST)) != 0;
  return in_box ? -alpha * log(alpha) - (1 - alpha) * log(1 - alpha) : -log(1 - alpha);
}

typedef pags_result pixel_term(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo, double weight,
                               float *transmittance_gradient, double *value);

static double run(pixel_term *term, fixture *f, int threads) {
  pags_tasks *const tasks = pags_tasks_create(threads);
  assert_non_null(tasks);
  double value = NAN;
  assert_int_equal(term(tasks, &f->picture, &f->photo, 0.3, f->by_transmittance, &value), PAGS_OK);
  pags_tasks_destroy(tasks);
  return value;
}

static void check_term(pixel_term *term, double (*pixel)(uint8_t, double), uint64_t seed, int masked) {
  fixture *const f = create(seed, masked), *const before = create(seed, masked);
  const double value = run(term, f, 2), scale = 0.3 / (double)count_pixels(f);
  double want = 0;
  for (int i = 0; i < PLANE; i++) {
    const double got = (double)f->by_transmittance[i] - (double)before->by_transmittance[i];
    if (!counts(f, i)) {
      assert_true(got == 0);
      continue;
    }
    const double t = (double)f->transmittance[i], step = 1e-4 * fmin(t, 1 - t);
    want += scale * pixel(f->labels[i], t);
    const double away = fmin(t, 1 - t) / 1e-6; /* distance to the clamp at 1e-6, where the derivative jumps */
    if (fabs(away - 1) < 0.1)
      continue;
    const double slope = step > 0 ? (pixel(f->labels[i], t + step) - pixel(f->labels[i], t - step)) / (2 * step) : 0;
    assert_true(fabs(got - scale * slope) <=
                1e-6 * scale * (1 / fmin(fmax(t, 1e-7), 1) + 1 / fmax(1 - t, 1e-7)) + 1e-12);
  }
  if (!(fabs(value - want) <= 1e-6 * want))
    fail_msg("%.9g, should be %.9g", value, want);
  free(before);
  free(f);
}

static void test_differences(void **state) {
  (void)state;
  for (int k = 0; k < 6; k++) {
    check_term(pags_driving_loss_sky, sky_pixel, 10 + (uint64_t)k, k & 1);
    check_term(pags_driving_loss_objects, objects_pixel, 20 + (uint64_t)k, k & 1);
  }
}

/* Returns a term's value if all pixels have the same label and transmittance, and its derivative by the
 * transmittance of one pixel, times the number of pixels. */
static double uniform_value(pixel_term *term, uint8_t labels, float t, double *slope) {
  fixture *const f = create(1, 0);
  for (int i = 0; i < PLANE; i++)
    f->transmittance[i] = t, f->labels[i] = labels, f->by_transmittance[i] = 0.0f;
  const double value = run(term, f, 1);
  *slope = (double)f->by_transmittance[STRIDE + 50] * WIDTH * HEIGHT;
  free(f);
  return value;
}

static void expect(pixel_term *term, uint8_t labels, float t, double value, double slope) {
  double got_slope;
  const double got = uniform_value(term, labels, t, &got_slope);
  if (!(fabs(got - 0.3 * value) <= 1e-6 * fabs(value) + 1e-8) || !(fabs(got_slope - 0.3 * slope) <= 1e-6 * fabs(slope)))
    fail_msg("labels %d, T %g: %.9g and %.9g, should be %.9g and %.9g", labels, (double)t, got, got_slope, 0.3 * value,
             0.3 * slope);
}

static void test_by_hand(void **state) {
  (void)state;
  expect(pags_driving_loss_sky, PAGS_LABEL_SKY, 0.25f, log(4), -4);
  expect(pags_driving_loss_sky, PAGS_LABEL_SKY | PAGS_LABEL_MOVING, 1.0f, 1e-6, 0);
  expect(pags_driving_loss_sky, 0, 0.25f, log(4.0 / 3), 4.0 / 3);
  expect(pags_driving_loss_sky, 0, 1.0f, log(1e6), 0);
  expect(pags_driving_loss_sky, PAGS_LABEL_SKY_UNKNOWN | PAGS_LABEL_MOVING, 0.25f, 0, 0);
  expect(pags_driving_loss_objects, PAGS_LABEL_SKY_UNKNOWN, 1.0f, 1e-6, 0);
  expect(pags_driving_loss_sky, PAGS_LABEL_CRITICAL, 0.9999f, -log(1 - (double)0.9999f), 1 / (1 - (double)0.9999f));
  expect(pags_driving_loss_objects, PAGS_LABEL_VEHICLE, 0.5f, log(2), 0);
  expect(pags_driving_loss_objects, PAGS_LABEL_PEDESTRIAN, 0.75f, 0.75 * log(4.0 / 3) + 0.25 * log(4), log(1.0 / 3));
  expect(pags_driving_loss_objects, PAGS_LABEL_CYCLIST, 0.25f, 0.75 * log(4.0 / 3) + 0.25 * log(4), log(3));
  expect(pags_driving_loss_objects, PAGS_LABEL_PARKED | PAGS_LABEL_MOVING | PAGS_LABEL_SKY, 0.5f, log(2), -2);
  expect(pags_driving_loss_objects, 0, 1.0f, 1e-6, 0);
}

static void test_threads(void **state) {
  (void)state;
  pixel_term *const terms[] = {pags_driving_loss_sky, pags_driving_loss_objects};
  for (int k = 0; k < 2; k++) {
    fixture *const one = create(5, 1);
    const double value = run(terms[k], one, 1);
    for (int threads = 2; threads <= 5; threads++) {
      fixture *const many = create(5, 1);
      assert_true(run(terms[k], many, threads) == value);
      assert_memory_equal(many->by_transmittance, one->by_transmittance, sizeof one->by_transmittance);
      free(many);
    }
    free(one);
  }
}

/* Without labels or counted pixels a term is 0 and doesn't change gradients; a photograph of another size is
 * refused. */
static void test_nothing(void **state) {
  (void)state;
  pixel_term *const terms[] = {pags_driving_loss_sky, pags_driving_loss_objects};
  pags_tasks *const tasks = pags_tasks_create(1);
  for (int k = 0; k < 2; k++) {
    fixture *const f = create(6, 1), *const before = create(6, 1);
    double value = 1;
    f->photo.labels = NULL;
    assert_int_equal(terms[k](tasks, &f->picture, &f->photo, 1, f->by_transmittance, &value), PAGS_OK);
    assert_true(value == 0);
    f->photo.labels = f->labels;
    memset(f->mask, 0, sizeof f->mask);
    value = 1;
    assert_int_equal(terms[k](tasks, &f->picture, &f->photo, 1, f->by_transmittance, &value), PAGS_OK);
    assert_true(value == 0);
    assert_memory_equal(f->by_transmittance, before->by_transmittance, sizeof f->by_transmittance);
    f->photo.width--;
    assert_int_equal(terms[k](tasks, &f->picture, &f->photo, 1, f->by_transmittance, &value), PAGS_ERROR_ARGUMENT);
    free(before);
    free(f);
  }
  pags_tasks_destroy(tasks);
}

/* ---- Depth ---- */

enum { SAMPLES = 400 };

static double run_depth_on(int threads, fixture *f, const pags_lidar_depth_sample *samples, int64_t count, int shrink,
                           double share) {
  double value = NAN;
  pags_tasks *const tasks = pags_tasks_create(threads);
  assert_non_null(tasks);
  assert_int_equal(pags_driving_loss_depth(tasks, &f->picture, &f->photo, samples, count, shrink, 0.7, share,
                                           f->by_depth_sum, f->by_transmittance, &value),
                   PAGS_OK);
  pags_tasks_destroy(tasks);
  return value;
}

static double run_depth(fixture *f, const pags_lidar_depth_sample *samples, int64_t count, int shrink, double share) {
  return run_depth_on(1, f, samples, count, shrink, share);
}

static void test_depth_by_hand(void **state) {
  (void)state;
  fixture *const f = create(7, 1);
  memset(f->by_transmittance, 0, sizeof f->by_transmittance);
  for (int i = 0; i < PLANE; i++)
    f->transmittance[i] = 0.5f, f->depth_sum[i] = 5.0f, f->mask[i] = 255; /* an expected depth of 10 m */
  f->transmittance[3 * STRIDE + 7] = 0.96f;
  f->mask[4 * STRIDE + 8] = 0;
  const pags_lidar_depth_sample samples[] = {
      /* At half size in pixel (10, 5): rendered 2 m too near. */
      {20.9f, 10.1f, 12.0f}, {22.0f, 10.0f, 9.0f},                         /* pixel (11, 5): rendered 1 m too far */
      {24.0f, 10.0f, 40.0f},                                               /* the largest error, which is trimmed */
      {14.5f, 6.5f, 11.0f},                                                /* a pixel that is too transparent */
      {16.5f, 8.5f, 11.0f},                                                /* a masked pixel */
      {-0.1f, 5.0f, 1.0f},   {202.0f, 5.0f, 1.0f}, {5.0f, 74.0f, 1.0f},    /* points outside of the picture */
      {NAN, 5.0f, 1.0f},     {5.0f, 1e30f, 1.0f},  {5.0f, 5.0f, INFINITY}, /* values that aren't finite */
      {20.0f, 11.0f, 9.5f},  /* pixel (10, 5) again: rendered half a metre too far */
      {26.0f, 10.0f, 10.0f}, /* a sample without error */
  };
  /* The smallest 4 of 5 errors are kept. */
  const double value = run_depth(f, samples, (int64_t)(sizeof samples / sizeof *samples), 2, 0.8);
  assert_true(fabs(value - 0.7 * (2 + 1 + 0.5 + 0) / 4) < 1e-6);
  for (int i = 0; i < PLANE; i++) {
    const int at_10 = i == 5 * STRIDE + 10, at_11 = i == 5 * STRIDE + 11;
    const double slope = at_10 ? 0 : at_11 ? 0.7 / 4 : 0; /* the two errors in pixel (10, 5) have opposite signs */
    assert_true(fabs((double)f->by_depth_sum[i] - slope / 0.5) < 1e-7);
    assert_true(fabs((double)f->by_transmittance[i] - slope * 5 / 0.25) < 1e-6);
  }
  free(f);
}

/* Returns the depth term in double for one sample a pixel; at pixel `moved`, if not negative, transmittance and depth
 * sum are changed by by_t and by_sum. */
static double plain_depth(const fixture *f, const pags_lidar_depth_sample *samples, double share, int moved,
                          double by_t, double by_sum) {
  double errors[SAMPLES];
  int n = 0;
  for (int k = 0; k < SAMPLES; k++) {
    const int at = (int)samples[k].y * STRIDE + (int)samples[k].x;
    const double alpha = 1 - (double)f->transmittance[at] - (at == moved ? by_t : 0);
    if (1.0f - f->transmittance[at] > 0.05f && f->mask[at])
      errors[n++] = fabs(((double)f->depth_sum[at] + (at == moved ? by_sum : 0)) / alpha - (double)samples[k].depth);
  }
  pags_sort_doubles(errors, n);
  const int kept = (int)ceil(share * n);
  double sum = 0;
  for (int k = 0; k < kept; k++)
    sum += errors[k];
  return 0.7 * sum / kept;
}

static void test_depth_differences(void **state) {
  (void)state;
  fixture *const f = create(8, 1);
  memset(f->by_transmittance, 0, sizeof f->by_transmittance);
  pags_lidar_depth_sample samples[SAMPLES];
  for (int k = 0; k < SAMPLES; k++) {
    const int at = k * 9; /* distinct pixels */
    samples[k] =
        (pags_lidar_depth_sample){(float)(at % WIDTH) + 0.5f, (float)(at / WIDTH) + 0.25f, (float)uniform(1, 60)};
  }
  const double value = run_depth(f, samples, SAMPLES, 1, 0.95);
  assert_true(fabs(value - plain_depth(f, samples, 0.95, -1, 0, 0)) < 1e-5 * value);
  int slopes = 0;
  for (int k = 0; k < SAMPLES; k++) {
    const int at = (int)samples[k].y * STRIDE + (int)samples[k].x;
    const double t = 1e-6, s = 1e-4;
    const double by_t = (plain_depth(f, samples, 0.95, at, t, 0) - plain_depth(f, samples, 0.95, at, -t, 0)) / (2 * t);
    const double by_sum =
        (plain_depth(f, samples, 0.95, at, 0, s) - plain_depth(f, samples, 0.95, at, 0, -s)) / (2 * s);
    assert_true(fabs((double)f->by_transmittance[at] - by_t) < 1e-4 * fabs(by_t) + 1e-6);
    assert_true(fabs((double)f->by_depth_sum[at] - by_sum) < 1e-5 * fabs(by_sum) + 1e-8);
    slopes += by_sum != 0;
  }
  assert_true(slopes > 150 && slopes < SAMPLES);
  free(f);
}

static void test_depth_of_nothing(void **state) {
  (void)state;
  fixture *const f = create(9, 0);
  const pags_lidar_depth_sample sample = {5, 5, 10};
  assert_true(run_depth(f, NULL, 0, 1, 0.95) == 0);
  assert_true(run_depth(f, &sample, 1, 1, 0) == 0);
  f->transmittance[5 * STRIDE + 5] = 1;
  assert_true(run_depth(f, &sample, 1, 1, 0.95) == 0);
  double value;
  pags_tasks *const tasks = pags_tasks_create(1);
  assert_non_null(tasks);
  f->picture.width--;
  assert_int_equal(pags_driving_loss_depth(tasks, &f->picture, &f->photo, &sample, 1, 1, 1, 1, f->by_depth_sum,
                                           f->by_transmittance, &value),
                   PAGS_ERROR_ARGUMENT);
  pags_tasks_destroy(tasks);
  free(f);
}

/* Many samples on each pixel, in several blocks, give the same bits for any number of threads. */
static void test_depth_threads(void **state) {
  (void)state;
  enum { MANY = 5000 };
  pags_lidar_depth_sample *const samples = calloc(MANY, sizeof *samples);
  double first_value = 0;
  fixture *first = NULL;
  for (int i = 0; i < MANY; i++)
    samples[i] = (pags_lidar_depth_sample){(float)(i * 7 % (10 * WIDTH)) * 0.1f, (float)(i * 13 % (10 * HEIGHT)) * 0.1f,
                                           5.0f + (float)(i % 997) * 0.01f};
  for (int threads = 1; threads <= 7; threads += 3) {
    fixture *const f = create(7, 1);
    const double value = run_depth_on(threads, f, samples, MANY, 1, 0.9);
    assert_true(value > 0);
    if (!first) {
      first = f;
      first_value = value;
      continue;
    }
    assert_memory_equal(&value, &first_value, sizeof value);
    assert_memory_equal(f->by_depth_sum, first->by_depth_sum, sizeof f->by_depth_sum);
    assert_memory_equal(f->by_transmittance, first->by_transmittance, sizeof f->by_transmittance);
    free(f);
  }
  free(first);
  free(samples);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_by_hand),           cmocka_unit_test(test_differences),
      cmocka_unit_test(test_threads),           cmocka_unit_test(test_nothing),
      cmocka_unit_test(test_depth_threads),     cmocka_unit_test(test_depth_by_hand),
      cmocka_unit_test(test_depth_differences), cmocka_unit_test(test_depth_of_nothing),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
