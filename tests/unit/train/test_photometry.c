/* SPDX-License-Identifier: Apache-2.0 */
/* Tests vignettes and response curves (train/photometry.h): gradients compared with finite differences, fixed
 * values, and recovery of the curves of three cameras. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "small_street.h"
#include "train/photometry.h"

enum { WIDTH = 40, HEIGHT = 24, STRIDE = 48, PLANE = STRIDE * HEIGHT };

static const pags_camera camera = {.width = WIDTH, .height = HEIGHT, .fx = 30, .fy = 30, .cx = 20, .cy = 12};
static float drawn[3][PLANE], shown[3][PLANE], weights[3][PLANE];

static pags_picture picture_of(void) {
  return (pags_picture){.width = WIDTH, .height = HEIGHT, .stride = STRIDE, .rgb = {drawn[0], drawn[1], drawn[2]}};
}

static double hashed(int a, int b) {
  const double x = sin(12.9898 * a + 78.233 * b + 0.7) * 43758.5453;
  return x - floor(x);
}

static void fill(void) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < PLANE; i++) {
      drawn[c][i] = (float)(0.03 + 0.94 * hashed(i, c)); /* with a bright vignette some values exceed 1 */
      weights[c][i] = (float)(hashed(i, 10 + c) - 0.5);
    }
}

static pags_photometry create(void) {
  pags_photometry p;
  assert_int_equal(pags_photometry_create(&p, dataset), PAGS_OK);
  assert_int_equal(p.count, 3);
  return p;
}

static double loss_of(const pags_photometry *p, int sensor) {
  const pags_photometric light = pags_photometry_of_sensor(p, sensor);
  const pags_picture picture = picture_of();
  float *const out[3] = {shown[0], shown[1], shown[2]};
  double sum = 0.0;
  assert_int_equal(pags_photometry_apply(tasks, &light, &camera, &picture, out), PAGS_OK);
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < HEIGHT; y++)
      for (int x = 0; x < WIDTH; x++)
        sum += (double)weights[c][y * STRIDE + x] * (double)shown[c][y * STRIDE + x];
  return sum;
}

static void test_gradient(void **state) {
  (void)state;
  pags_photometry p = create();
  fill();
  pags_photometry_part *part = &p.parts[1];
  for (int k = 0; k < PAGS_VIGNETTING_RINGS; k++)
    part->vignette[k] = 0.3 * hashed(k, 31) - 0.3;
  for (int i = 0; i < PAGS_RESPONSE_PIECES; i++)
    part->slopes[i] = hashed(i, 32) - 0.5;
  const pags_photometric light = pags_photometry_of_sensor(&p, 1);
  assert_true(pags_photometric_is_valid(&light) && !pags_photometric_is_identity(&light));
  const pags_picture picture = picture_of();
  static float gradient[3][PLANE];
  float *const planes[3] = {gradient[0], gradient[1], gradient[2]};
  pags_photometric_gradient got, other;
  memcpy(gradient, weights, sizeof gradient);
  assert_int_equal(pags_photometry_back(tasks, &light, &camera, &picture, planes, &got), PAGS_OK);

  double *const numbers[2] = {part->vignette, part->slopes};
  const double *const by[2] = {got.vignette, got.slopes};
  for (int kind = 0; kind < 2; kind++)
    for (int i = 0; i < (kind ? PAGS_RESPONSE_PIECES : PAGS_VIGNETTING_RINGS); i++) {
      const double step = 1e-3, begun = numbers[kind][i];
      double sides[2];
      for (int side = 0; side < 2; side++) {
        numbers[kind][i] = begun + (side ? step : -step);
        sides[side] = loss_of(&p, 1);
      }
      numbers[kind][i] = begun;
      const double want = (sides[1] - sides[0]) / (2 * step);
      if (!(fabs(by[kind][i] - want) <
            0.01 * (1.0 + fabs(want)))) /* the tolerance is for pixels that cross a bend of the curve */
        fail_msg("number %d of kind %d: %.6g, should be %.6g", i, kind, by[kind][i], want);
    }
  for (int i = 0; i < 20; i++) {
    const int x = (7 * i) % WIDTH, y = (5 * i) % HEIGHT, c = i % 3, at = y * STRIDE + x;
    const float begun = drawn[c][at];
    double sides[2];
    for (int side = 0; side < 2; side++) {
      drawn[c][at] = begun + (side ? 1e-4f : -1e-4f);
      sides[side] = loss_of(&p, 1);
    }
    drawn[c][at] = begun;
    const double want = (sides[1] - sides[0]) / 2e-4;
    if (!(fabs((double)gradient[c][at] - want) < 0.02 + 0.02 * fabs(want)))
      fail_msg("pixel %d %d of channel %d: %.6g, should be %.6g", x, y, c, (double)gradient[c][at], want);
  }

  /* One thread gives the same bits. */
  pags_tasks *one = pags_tasks_create(1);
  memcpy(gradient, weights, sizeof gradient);
  assert_int_equal(pags_photometry_back(one, &light, &camera, &picture, planes, &other), PAGS_OK);
  assert_memory_equal(&got, &other, sizeof got);
  pags_tasks_destroy(one);
  pags_photometry_destroy(&p);
}

/* Photographs of known light by three cameras: their vignettes and curves are found to 2 %. */
static void test_found(void **state) {
  (void)state;
  enum { STEPS = 4500 };
  pags_photometry p = create(), truth = create();
  pags_train_config config = pags_train_config_default();
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 30);
  schedule.length = STEPS;
  for (int s = 0; s < 3; s++) {
    double mean = 0.0;
    for (int k = 0; k < PAGS_VIGNETTING_RINGS; k++) {
      truth.parts[s].vignette[k] = -(0.05 + 0.02 * s) * k;
      mean += truth.parts[s].share[k] * truth.parts[s].vignette[k];
    }
    for (int k = 0; k < PAGS_VIGNETTING_RINGS; k++)
      truth.parts[s].vignette[k] -= mean; /* with mean 0, as training keeps them */
    for (int i = 0; i < PAGS_RESPONSE_PIECES; i++)
      truth.parts[s].slopes[i] = (s - 1) * 0.3 * (i - 2.5) / 2.5; /* mean 0 over the cameras and over the pieces */
  }
  fill();
  const pags_picture picture = picture_of();
  float *const out[3] = {shown[0], shown[1], shown[2]};
  static float wanted[3][3][PLANE];
  for (int s = 0; s < 3; s++) {
    float *const planes[3] = {wanted[s][0], wanted[s][1], wanted[s][2]};
    const pags_photometric light = pags_photometry_of_sensor(&truth, s);
    assert_int_equal(pags_photometry_apply(tasks, &light, &camera, &picture, planes), PAGS_OK);
  }
  for (int step = 1; step <= STEPS; step++) {
    const int s = step % 3;
    const pags_photometric light = pags_photometry_of_sensor(&p, s);
    pags_photometric_gradient gradient;
    assert_int_equal(pags_photometry_apply(tasks, &light, &camera, &picture, out), PAGS_OK);
    for (int c = 0; c < 3; c++)
      for (int i = 0; i < PLANE; i++)
        shown[c][i] = i % STRIDE < WIDTH ? shown[c][i] - wanted[s][c][i] : 0.0f;
    assert_int_equal(pags_photometry_back(tasks, &light, &camera, &picture, out, &gradient), PAGS_OK);
    assert_true(pags_photometry_update(&p, s, &gradient, &schedule, step));
  }
  double worst = 0.0;
  for (int s = 0; s < 3; s++) {
    const pags_photometric got = pags_photometry_of_sensor(&p, s), want = pags_photometry_of_sensor(&truth, s);
    for (double q = 0.0; q <= 1.0; q += 0.1)
      worst = fmax(worst, fabs(pags_photometric_vignetting(&got, q) - pags_photometric_vignetting(&want, q)));
    for (int i = 0; i <= PAGS_RESPONSE_PIECES; i++)
      worst = fmax(worst, fabs(pags_photometric_curve_point(&got, i) - pags_photometric_curve_point(&want, i)));
  }
  print_message("off by %.4f at most\n", worst);
  assert_true(worst < 0.02);
  for (int i = 0; i < PAGS_RESPONSE_PIECES; i++)
    assert_true(fabs(p.parts[0].slopes[i] + p.parts[1].slopes[i] + p.parts[2].slopes[i]) < 1e-9);
  const pags_photometric_gradient bad = {.slopes = {(double)NAN}};
  const pags_photometry_part kept = p.parts[2];
  assert_false(pags_photometry_update(&p, 2, &bad, &schedule, 5));
  assert_memory_equal(kept.slopes, p.parts[2].slopes, sizeof kept.slopes);
  pags_photometry_destroy(&p);
  pags_photometry_destroy(&truth);
}

/* A frame applies the camera's vignette and curve to the background, and then the exposure. */
static void test_frame(void **state) {
  (void)state;
  pags_frame *frame;
  pags_picture picture;
  pags_frame_options options = pags_frame_options_default();
  const double gain[3] = {1.1, 1.0, 0.9}, offset[3] = {0.01, 0.0, -0.02};
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  for (int c = 0; c < 3; c++)
    options.background[c] = 0.4f + 0.2f * (float)c;
  options.photometric =
      (pags_photometric){.vignette = {0.0, -0.1, -0.2, -0.4}, .response = {0.02, 0.03, 0.01, -0.01, -0.02}};
  assert_true(pags_frame_options_expose(&options, gain, offset));
  assert_int_equal(pags_frame_render(frame, NULL, 0, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < HEIGHT; y++)
      for (int x = 0; x < WIDTH; x++) {
        const double u = (x - 19.5) / 20.0, v = (y - 11.5) / 12.0, q = (u * u * 400.0 + v * v * 144.0) / 544.0;
        const double keyframes[4] = {1.0, 0.9, 0.8, 0.6};
        const int ring = q < 1.0 / 3.0 ? 0 : q < 2.0 / 3.0 ? 1 : 2;
        const double value = (double)options.background[c] *
                             (keyframes[ring] + (keyframes[ring + 1] - keyframes[ring]) * (3.0 * q - ring));
        const double curve[7] = {0.0, 1.0 / 6 + 0.02, 2.0 / 6 + 0.03, 3.0 / 6 + 0.01, 4.0 / 6 - 0.01, 5.0 / 6 - 0.02,
                                 1.0};
        const int piece = (int)(6.0 * value);
        const double seen = curve[piece] + (curve[piece + 1] - curve[piece]) * (6.0 * value - piece);
        const double got = (double)picture.rgb[c][y * picture.stride + x];
        assert_true(fabs(got - (gain[c] * seen + offset[c])) < 1e-5);
      }
  options.photometric = (pags_photometric){.vignette = {0.0}};
  assert_false(pags_frame_options_expose(&options, (double[3]){1, 1, 1}, (double[3]){0, 0, 0}));
  pags_frame_destroy(frame);
}

int main(void) {
  small_street_cameras = 3;
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_gradient), cmocka_unit_test(test_found),
                                     cmocka_unit_test(test_frame)};
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
