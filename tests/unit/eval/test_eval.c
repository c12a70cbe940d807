/* SPDX-License-Identifier: Apache-2.0 */
/* Compares PSNR and SSIM with closed forms and with a direct evaluation of their definitions. */
#include <pags/eval.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

/* cmocka compares in float; this macro compares in double. */
#define assert_near(value, expected, tolerance) assert_true(fabs((value) - (expected)) <= (tolerance))

static pags_image make_image(int width, int height) {
  pags_image image = {0};
  assert_int_equal(pags_image_create(&image, width, height, 3, PAGS_F32), PAGS_OK);
  return image;
}

static float noise(uint32_t *state) {
  *state = *state * 1664525u + 1013904223u;
  return (float)(*state >> 8) / 16777216.0f;
}

/* Paints smooth colours plus noise; some values leave [0, 1]. */
static void paint(pags_image *image, uint32_t seed, float amount) {
  float *p = image->data;
  for (int y = 0; y < image->height; y++)
    for (int x = 0; x < image->width; x++)
      for (int c = 0; c < 3; c++)
        p[(y * image->width + x) * 3 + c] =
            0.5f + 0.4f * sinf(0.3f * (float)x + (float)c) * cosf(0.2f * (float)y) + amount * (noise(&seed) - 0.5f);
}

static void test_psnr_closed_form(void **state) {
  (void)state;
  pags_image a = make_image(7, 5), b = make_image(7, 5);
  double psnr = 0.0;
  for (int i = 0; i < 7 * 5 * 3; i++) {
    ((float *)a.data)[i] = 0.25f;
    ((float *)b.data)[i] = 0.75f;
  }
  assert_int_equal(pags_eval_psnr(&a, &b, NULL, &psnr), PAGS_OK);
  assert_near(psnr, 20.0 * log10(2.0), 1e-9);
  assert_int_equal(pags_eval_psnr(&a, &a, NULL, &psnr), PAGS_OK);
  assert_true(isinf(psnr) && psnr > 0.0);

  /* Values outside of [0, 1] are clamped, NaN counts as black. */
  for (int i = 0; i < 7 * 5 * 3; i++) {
    ((float *)a.data)[i] = i % 2 ? -3.0f : NAN;
    ((float *)b.data)[i] = 2.0f;
  }
  assert_int_equal(pags_eval_psnr(&a, &b, NULL, &psnr), PAGS_OK);
  assert_near(psnr, 0.0, 1e-9);
  pags_image_destroy(&a);
  pags_image_destroy(&b);
}

static void test_psnr_mask(void **state) {
  (void)state;
  pags_image a = make_image(4, 1), b = make_image(4, 1);
  const uint8_t mask[4] = {0, 255, 1, 0}, none[4] = {0};
  double psnr = 0.0;
  for (int i = 0; i < 12; i++) {
    ((float *)a.data)[i] = 0.5f;
    ((float *)b.data)[i] = i / 3 == 1 ? 0.6f : i / 3 == 2 ? 0.3f : 1.0f;
  }
  assert_int_equal(pags_eval_psnr(&a, &b, mask, &psnr), PAGS_OK);
  assert_near(psnr, -10.0 * log10((0.01 + 0.04) / 2.0), 1e-5);
  assert_int_equal(pags_eval_psnr(&a, &b, none, &psnr), PAGS_OK);
  assert_true(isnan(psnr));
  pags_image_destroy(&a);
  pags_image_destroy(&b);
}

/* SSIM by its definition, with 121 products for each moment of the 11 x 11 window. */
static double plain_ssim(const pags_image *a, const pags_image *b, const uint8_t *mask) {
  double window[11][11], total = 0.0, sum = 0.0;
  int64_t counted = 0;
  for (int i = 0; i < 11; i++)
    for (int j = 0; j < 11; j++)
      total += window[i][j] = exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / 4.5);
  for (int y = 0; y < a->height; y++)
    for (int x = 0; x < a->width; x++) {
      if (mask && !mask[y * a->width + x])
        continue;
      counted++;
      for (int c = 0; c < 3; c++) {
        double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
        for (int i = -5; i <= 5; i++)
          for (int j = -5; j <= 5; j++) {
            if (y + i < 0 || y + i >= a->height || x + j < 0 || x + j >= a->width)
              continue;
            int64_t at = ((y + i) * a->width + x + j) * 3 + c;
            double va = fmin(1.0, fmax(0.0, (double)((const float *)a->data)[at]));
            double vb = fmin(1.0, fmax(0.0, (double)((const float *)b->data)[at]));
            double w = window[i + 5][j + 5] / total;
            ma += w * va, mb += w * vb, aa += w * va * va, bb += w * vb * vb, ab += w * va * vb;
          }
        sum += (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
               ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
      }
    }
  return sum / (3.0 * (double)counted);
}

static void test_ssim_definition(void **state) {
  (void)state;
  static const int sizes[][2] = {{31, 23}, {5, 40}, {1, 1}, {64, 3}};
  pags_tasks *tasks = pags_tasks_create(2);
  for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
    pags_image a = make_image(sizes[i][0], sizes[i][1]), b = make_image(sizes[i][0], sizes[i][1]);
    uint8_t *mask = calloc((size_t)(a.width * a.height), 1);
    paint(&a, 1, 0.3f);
    paint(&b, 2, 0.5f);
    for (int k = 0; k < a.width * a.height; k++)
      mask[k] = k % 3 != 1;
    double ssim = 0.0;
    assert_int_equal(pags_eval_ssim(&a, &b, NULL, tasks, &ssim), PAGS_OK);
    assert_near(ssim, plain_ssim(&a, &b, NULL), 1e-12);
    assert_int_equal(pags_eval_ssim(&a, &b, mask, tasks, &ssim), PAGS_OK);
    assert_near(ssim, plain_ssim(&a, &b, mask), 1e-12);
    assert_int_equal(pags_eval_ssim(&a, &a, NULL, tasks, &ssim), PAGS_OK);
    assert_near(ssim, 1.0, 1e-12);
    free(mask);
    pags_image_destroy(&a);
    pags_image_destroy(&b);
  }
  pags_tasks_destroy(tasks);
}

static void test_ssim_threads(void **state) {
  (void)state;
  pags_image a = make_image(97, 61), b = make_image(97, 61);
  paint(&a, 3, 0.2f);
  paint(&b, 4, 0.2f);
  double first = 0.0;
  for (int threads = 1; threads <= 5; threads++) {
    double ssim = 0.0;
    pags_tasks *tasks = pags_tasks_create(threads);
    assert_int_equal(pags_eval_ssim(&a, &b, NULL, tasks, &ssim), PAGS_OK);
    pags_tasks_destroy(tasks);
    if (threads == 1)
      first = ssim;
    assert_memory_equal(&ssim, &first, sizeof ssim);
  }
  pags_image_destroy(&a);
  pags_image_destroy(&b);
}

/* The metrics of each region equal those with a mask of the same pixels. */
static void test_regions(void **state) {
  (void)state;
  enum { WIDTH = 37, HEIGHT = 29, COUNT = 4 };
  pags_image a = make_image(WIDTH, HEIGHT), b = make_image(WIDTH, HEIGHT);
  pags_tasks *tasks = pags_tasks_create(2);
  uint16_t regions[WIDTH * HEIGHT];
  double psnr[COUNT], ssim[COUNT], one;
  paint(&a, 1, 0.1f);
  paint(&b, 2, 0.4f);
  for (int i = 0; i < WIDTH * HEIGHT; i++) /* regions: all pixels, a third of them, the lower half, none */
    regions[i] = (uint16_t)(1 | (i % 3 == 0) << 1 | (i > WIDTH * HEIGHT / 2) << 2);
  assert_int_equal(pags_eval_regions(&a, &b, regions, COUNT, tasks, psnr, ssim), PAGS_OK);
  for (int r = 0; r < COUNT - 1; r++) {
    uint8_t mask[WIDTH * HEIGHT];
    for (int i = 0; i < WIDTH * HEIGHT; i++)
      mask[i] = regions[i] >> r & 1;
    assert_int_equal(pags_eval_psnr(&a, &b, mask, &one), PAGS_OK);
    assert_near(psnr[r], one, 1e-12);
    assert_int_equal(pags_eval_ssim(&a, &b, mask, tasks, &one), PAGS_OK);
    assert_near(ssim[r], one, 1e-12);
  }
  assert_true(isnan(psnr[COUNT - 1]) && isnan(ssim[COUNT - 1]));
  pags_tasks_destroy(tasks);
  pags_image_destroy(&a);
  pags_image_destroy(&b);
}

static void test_wrong_pairs(void **state) {
  (void)state;
  pags_image a = make_image(8, 8), b = make_image(8, 9), bytes = {0};
  double value = 0.0;
  pags_tasks *tasks = pags_tasks_create(1);
  assert_int_equal(pags_image_create(&bytes, 8, 8, 3, PAGS_U8), PAGS_OK);
  assert_int_equal(pags_eval_psnr(&a, &b, NULL, &value), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_eval_ssim(&a, &b, NULL, tasks, &value), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_eval_psnr(&a, &bytes, NULL, &value), PAGS_ERROR_ARGUMENT);
  pags_image_destroy(&a);
  pags_image_destroy(&b);
  pags_image_destroy(&bytes);
  pags_tasks_destroy(tasks);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_psnr_closed_form), cmocka_unit_test(test_psnr_mask), cmocka_unit_test(test_ssim_definition),
      cmocka_unit_test(test_ssim_threads),     cmocka_unit_test(test_regions),   cmocka_unit_test(test_wrong_pairs),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
