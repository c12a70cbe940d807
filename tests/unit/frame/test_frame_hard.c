/* SPDX-License-Identifier: Apache-2.0 */
/* Tests hard cases at which other programs fail on whole frames: for any input the results are finite. The numbers
 * (#2, #13, ...) are those of the cases in docs/lab/numerics.md. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

/* A camera at the world's origin looking along z, so that cases can be written in camera space. */
static void camera_at_origin(fixture *f) {
  const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(f->camera.world_from_camera, identity, sizeof identity);
}

static void place(fixture *f, int64_t i, double x, double y, double z, double sigma, double logit) {
  const double values[11] = {x, y, z, log(sigma), log(sigma), log(sigma), 1, 0, 0, 0, logit};
  for (int plane = 0; plane < 11; plane++)
    *fixture_at(f, plane, i) = values[plane];
}

static int gradient_is_zero(const frame_result *result) {
  const frame_part_result *part = &result->parts[0];
  for (int64_t k = 0; k < part->count * part->plane_count; k++) {
    if (part->planes[k] != 0)
      return 0;
  }
  return 1;
}

static void expect_nothing_drawn(const fixture *f) {
  frame_result result = fixture_run_finite(f);
  assert_true(fixture_is_background(f, &result));
  assert_true(gradient_is_zero(&result));
  frame_result_destroy(&result);
}

static void test_empty_part(void **state) {
  (void)state;
  fixture f = fixture_create(9, 0);
  expect_nothing_drawn(&f);
  fixture_destroy(&f);
}

/* #13 and the extreme of #22: there are rows, but none is in view. */
static void test_nothing_in_view(void **state) {
  (void)state;
  fixture f = fixture_create(10, 200);
  camera_at_origin(&f);
  for (int64_t i = 0; i < 200; i++)
    place(&f, i, 0.01 * (double)i, 0, i % 2 ? -3.0 : 0.005, 0.001, 1);
  expect_nothing_drawn(&f);
  for (int64_t i = 0; i < 200; i++) /* in front of the camera, far to the side */
    place(&f, i, 100 + (double)i, 0, 3, 0.01, 1);
  expect_nothing_drawn(&f);
  fixture_destroy(&f);
}

/* #2: scales whose exponential overflows, and every other parameter that isn't finite. The picture is finite; where
 * the row can't be drawn, its neighbours in the same SIMD vector and cluster aren't affected. (A quaternion that
 * isn't finite may be replaced by the identity, as the zero quaternion is.) */
static void test_non_finite_rows(void **state) {
  (void)state;
  fixture f = fixture_create(11, 24);
  const double bad[] = {INFINITY, -INFINITY, NAN, 1e30, -1e30, 100};
  frame_scene_round(&f.part);
  double opacity = *fixture_at(&f, PAGS_OPACITY, 5);
  *fixture_at(&f, PAGS_OPACITY, 5) = -20;
  frame_result without = fixture_run_finite(&f);
  *fixture_at(&f, PAGS_OPACITY, 5) = opacity;
  int undrawable = 0;
  for (int plane = 0; plane < PAGS_SH; plane++) {
    double good = *fixture_at(&f, plane, 5);
    for (int k = 0; k < 6; k++) {
      *fixture_at(&f, plane, 5) = bad[k];
      frame_result result = fixture_run_finite(&f);
      reference_picture exact = reference_render(&f.part, 1, &f.camera, &f.options);
      int is_rotation = plane >= PAGS_ROTATION && plane < PAGS_OPACITY;
      if (!exact.splats[5].drawn && !is_rotation) {
        undrawable++;
        assert_memory_equal(result.rgb, without.rgb, 3 * PIXELS * sizeof(float));
        assert_memory_equal(result.id, without.id, PIXELS * sizeof(int32_t));
        assert_memory_equal(result.parts[0].planes, without.parts[0].planes, 24 * PAGS_MAX_PLANES * sizeof(float));
      }
      reference_picture_destroy(&exact);
      frame_result_destroy(&result);
    }
    *fixture_at(&f, plane, 5) = good;
  }
  assert_true(undrawable > 20);
  frame_result_destroy(&without);
  fixture_destroy(&f);
}

/* #3: Gaussians at the camera centre, at z = 0 to its side, and close to it. */
static void test_at_the_camera(void **state) {
  (void)state;
  fixture f = fixture_create(12, 6);
  camera_at_origin(&f);
  const double offsets[6][3] = {{0, 0, 0}, {1, 0, 0}, {0, -1, 0}, {1e-20, 0, 1e-20}, {0, 0, -1e-30}, {0, 0, 1e-38}};
  for (int64_t i = 0; i < 6; i++)
    place(&f, i, offsets[i][0], offsets[i][1], offsets[i][2], i % 2 ? 1e-9 : 1, 2);
  expect_nothing_drawn(&f);
  fixture_destroy(&f);
}

/* #5, #6: the zero quaternion. */
static void test_zero_quaternion(void **state) {
  (void)state;
  fixture f = fixture_create(13, 8);
  frame_result results[2];
  for (int zero = 0; zero < 2; zero++) {
    for (int64_t i = 0; i < 8; i++) {
      for (int k = 0; k < 4; k++)
        *fixture_at(&f, PAGS_ROTATION + k, i) = k == 0 && !zero;
    }
    results[zero] = fixture_run_finite(&f);
  }
  assert_memory_equal(results[0].rgb, results[1].rgb, 3 * PIXELS * sizeof(float));
  for (int64_t i = 0; i < 4 * 8; i++)
    assert_true(results[1].parts[0].planes[PAGS_ROTATION * 8 + i] == 0);
  frame_result_destroy(&results[0]);
  frame_result_destroy(&results[1]);
  fixture_destroy(&f);
}

/* #6: scaling a quaternion by a power of two changes no bit of the picture, through a pinhole or a lens; gradients
 * are finite. */
static void test_quaternion_lengths(void **state) {
  (void)state;
  const int powers[] = {-120, -100, -64, -50, -49, -10, 10, 62, 63, 64, 65, 100, 120};
  for (int lens = 0; lens < 2; lens++) {
    fixture f = fixture_create(21, 40);
    frame_scene_round(&f.part);
    if (lens) {
      f.camera.lens = (pags_lens_model){.kind = PAGS_LENS_FISHEYE};
      assert_int_equal(pags_camera_check(&f.camera, "it"), PAGS_OK);
    }
    frame_result plain = fixture_run_finite(&f);
    for (size_t n = 0; n < sizeof powers / sizeof *powers; n++) {
      fixture other = fixture_create(21, 40);
      other.camera.lens = f.camera.lens;
      frame_scene_round(&other.part);
      for (int64_t i = 0; i < 40; i++)
        for (int k = 0; k < 4 && i % 3; k++) /* some quaternions keep their length */
          *fixture_at(&other, PAGS_ROTATION + k, i) *= ldexp(1, powers[n]);
      frame_result result = fixture_run_finite(&other);
      assert_memory_equal(result.rgb, plain.rgb, 3 * PIXELS * sizeof(float));
      frame_result_destroy(&result);
      fixture_destroy(&other);
    }
    frame_result_destroy(&plain);
    fixture_destroy(&f);
  }
}

/* #7: a needle with axes of 1:1e4 at 45 degrees through the picture's centre covers its line and nothing else. */
static void test_needle_does_not_flash(void **state) {
  (void)state;
  fixture f = fixture_create(14, 1);
  camera_at_origin(&f);
  f.camera.cx = 50.5, f.camera.cy = 33.5, f.camera.fx = f.camera.fy = 90;
  for (int direction = -1; direction <= 1; direction += 2) {
    place(&f, 0, 0, 0, 2, 4e-5, 3);
    *fixture_at(&f, PAGS_SCALE, 0) = log(0.4);
    *fixture_at(&f, PAGS_ROTATION, 0) = cos(0.39269908169872414);
    *fixture_at(&f, PAGS_ROTATION + 3, 0) = direction * sin(0.39269908169872414);
    frame_result result = fixture_run_finite(&f);
    int covered = 0;
    for (int k = 0; k < PIXELS; k++) {
      double dx = k % WIDTH + 0.5 - f.camera.cx, dy = k / WIDTH + 0.5 - f.camera.cy;
      double across = fabs(dy - direction * dx) / sqrt(2), along = fabs(dx + direction * dy) / sqrt(2);
      if (across > 1.85) /* extent of the low-pass filter across the needle: sqrt(2 ln(255 o) 0.3) px */
        assert_true(result.transmittance[k] == 1);
      if (across < 0.1 && along < 18)
        assert_true(result.transmittance[k] < 0.5f);
      covered += result.transmittance[k] < 1;
    }
    assert_true(covered > 60);
    frame_result_destroy(&result);
  }
  fixture_destroy(&f);
}

/* #8: Gaussians thousands of pictures wide produce at most one pair for each tile. */
static void test_giants(void **state) {
  (void)state;
  fixture f = fixture_create(15, 4);
  camera_at_origin(&f);
  const double sigmas[4] = {1e3, 1e5, 1e8, 1e12};
  for (int64_t i = 0; i < 4; i++)
    place(&f, i, 0.1, 0.2, 1 + (double)i, sigmas[i], -2);
  engine e = engine_create(2);
  frame_result result = fixture_run(&e, &f, 16, 0);
  assert_true(frame_result_finite(&result));
  const int64_t tiles = ((WIDTH + 15) / 16) * ((HEIGHT + 15) / 16);
  assert_true(pags_frame_stats_get(e.frame)->pairs_binned <= 4 * tiles);
  /* The smaller ones are drawn, from corner to corner of the picture. */
  assert_true(result.transmittance[0] < 0.9f);
  assert_true(result.transmittance[PIXELS - 1] < 0.9f);
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* #9: long Gaussians outside of the frustum, close to the camera's plane; compared with the oracle, which evaluates
 * the definition. */
static void test_fans_beside_the_picture(void **state) {
  (void)state;
  fixture f = fixture_create(16, 24);
  camera_at_origin(&f);
  for (int64_t i = 0; i < 24; i++) {
    double angle = 0.2617993877991494 * (double)i;
    place(&f, i, 1.5 * cos(angle), 1.5 * sin(angle), 0.3 + 0.013 * (double)i, 0.02, 0);
    *fixture_at(&f, PAGS_SCALE + 2, i) = log(0.8);
  }
  frame_scene_round(&f.part);
  frame_result result = fixture_run_finite(&f);
  reference_picture exact = reference_render(&f.part, 1, &f.camera, &f.options);
  assert_true(exact.contribution_count > 100);
  int compared = 0;
  for (int k = 0; k < PIXELS; k++) {
    if (exact.margin[k] < 1e-4 || exact.depth_margin[k] < 1e-6)
      continue;
    compared++;
    for (int channel = 0; channel < 3; channel++)
      assert_true(fabs((double)result.rgb[channel * PIXELS + k] - exact.rgb[channel * PIXELS + k]) < 1e-4);
  }
  assert_true(compared > PIXELS * 9 / 10);
  reference_picture_destroy(&exact);
  frame_result_destroy(&result);
  fixture_destroy(&f);
}

/* #10: near planes. */
static void test_near_planes(void **state) {
  (void)state;
  fixture f = fixture_create(17, 1);
  camera_at_origin(&f);
  const float planes[3] = {0.001f, 0.01f, 0.2f};
  const double depths[4] = {0.0005, 0.005, 0.1, 0.5};
  for (int p = 0; p < 3; p++) {
    for (int d = 0; d < 4; d++) {
      f.options.near_plane = planes[p];
      place(&f, 0, 0, 0, depths[d], 0.02 * depths[d], 2);
      frame_result result = fixture_run_finite(&f);
      assert_int_equal(!fixture_is_background(&f, &result), depths[d] > (double)planes[p]);
      assert_int_equal(result.parts[0].drawn[0], depths[d] > (double)planes[p]);
      frame_result_destroy(&result);
    }
  }
  fixture_destroy(&f);
}

/* Gaussians beyond a clipping plane give the same bits as transparent ones, also with Early-Z. */
static void test_clips(void **state) {
  (void)state;
  enum { COUNT = 300 };
  fixture f = fixture_create(23, COUNT), kept = fixture_create(23, COUNT);
  const double planes[2][4] = {{1, 0.2, 0, -0.1},
                               {0, 0, -1, 3}}; /* planes relative to the camera: on its right, and nearer than 3 m */
  int outside = 0;
  camera_at_origin(&f);
  camera_at_origin(&kept);
  for (int64_t i = 0; i < COUNT; i++) {
    const double x = 0.07 * (double)(i % 17) - 0.56, y = 0.06 * (double)(i % 13) - 0.36, z = 1.5 + 0.01 * (double)i;
    const bool inside = x + 0.2 * y - 0.1 >= 0 && 3 - z >= 0;
    place(&f, i, x, y, z, 0.05, 1);
    place(&kept, i, x, y, z, 0.05, inside ? 1 : -100);
    outside += !inside;
  }
  f.options.clip_count = 2;
  for (int p = 0; p < 2; p++) {
    memcpy(f.options.clips[p], planes[p], sizeof planes[p]);
    for (int k = 0; k < 3; k++)
      f.options.clips[p][3] -= planes[p][k] * f.options.origin[k];
  }
  for (int k = 0; k < 3; k++) {
    f.camera.world_from_camera[4 * k + 3] = f.options.origin[k];
    kept.camera.world_from_camera[4 * k + 3] = kept.options.origin[k];
  }
  frame_result clipped = fixture_run_finite(&f), wanted = fixture_run_finite(&kept);
  assert_true(outside > 50 && outside < COUNT - 50);
  assert_true(!fixture_is_background(&f, &clipped));
  assert_memory_equal(clipped.rgb, wanted.rgb, 3 * PIXELS * sizeof *clipped.rgb);
  f.options.clip_count = 0;
  frame_result whole = fixture_run_finite(&f);
  assert_memory_not_equal(whole.rgb, wanted.rgb, 3 * PIXELS * sizeof *clipped.rgb);
  frame_result_destroy(&whole);
  frame_result_destroy(&wanted);
  frame_result_destroy(&clipped);
  fixture_destroy(&kept);
  fixture_destroy(&f);
}

/* #12: opacities below 1/255, for which ln(255 o) is negative. */
static void test_below_one_level(void **state) {
  (void)state;
  fixture f = fixture_create(18, 40);
  for (int64_t i = 0; i < 40; i++)
    *fixture_at(&f, PAGS_OPACITY, i) = -5.6 - 0.5 * (double)i; /* the logit of 1/255 is -5.537 */
  engine e = engine_create(1);
  frame_result result = fixture_run(&e, &f, 16, 0);
  assert_int_equal(pags_frame_stats_get(e.frame)->pairs_binned, 0);
  assert_true(fixture_is_background(&f, &result) && gradient_is_zero(&result));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* #15, #16: stacks of Gaussians of the largest opacity: the early stop keeps the transmittance away from underflow in
 * the forward and the backward pass. */
static void test_opaque_stacks(void **state) {
  (void)state;
  const double logits[5] = {4, 8, 17, 100, 1e30};
  for (int k = 0; k < 5; k++) {
    fixture f = fixture_create(19, 500);
    camera_at_origin(&f);
    for (int64_t i = 0; i < 500; i++)
      place(&f, i, 0, 0, 1 + 0.01 * (double)i, 0.3, logits[k]);
    frame_result result = fixture_run_finite(&f);
    for (int pixel = 0; pixel < PIXELS; pixel++)
      assert_true(result.transmittance[pixel] >= 0.9999e-4f && result.transmittance[pixel] <= 1);
    assert_int_equal(result.bad_rows, 0);
    assert_int_equal(result.id[HEIGHT / 2 * WIDTH + WIDTH / 2], 0);
    frame_result_destroy(&result);
    fixture_destroy(&f);
  }
}

/* #18: the same scene a million metres away from the origin. */
static void test_far_from_the_origin(void **state) {
  (void)state;
  fixture f = fixture_create(20, 500);
  frame_result here = fixture_run_finite(&f);
  for (int k = 0; k < 3; k++) {
    f.options.origin[k] = 1e6 + 12345.678 * k;
    f.camera.world_from_camera[4 * k + 3] += f.options.origin[k];
  }
  frame_result there = fixture_run_finite(&f);
  int differ = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    differ += fabsf(here.rgb[k] - there.rgb[k]) > 1e-3f;
  assert_int_equal(differ, 0);
  frame_result_destroy(&here);
  frame_result_destroy(&there);
  fixture_destroy(&f);
}

/* #26: negative colours are clamped to 0, and NaN doesn't reach the pixels. */
static void test_negative_and_nan_colour(void **state) {
  (void)state;
  fixture f = fixture_create(21, 32);
  for (int64_t i = 0; i < 32; i++) {
    for (int plane = PAGS_SH; plane < PAGS_MAX_PLANES; plane++)
      *fixture_at(&f, plane, i) = plane < PAGS_SH + 3 ? -5 : 0;
  }
  frame_result result = fixture_run_finite(&f);
  for (int channel = 0; channel < 3; channel++) {
    for (int k = 0; k < PIXELS; k++) {
      float expected = result.transmittance[k] * f.options.background[channel];
      assert_true(fabsf(result.rgb[channel * PIXELS + k] - expected) < 1e-6f);
    }
  }
  for (int64_t k = PAGS_SH * 32; k < PAGS_MAX_PLANES * 32; k++)
    assert_true(result.parts[0].planes[k] == 0);
  frame_result_destroy(&result);

  for (int64_t i = 0; i < 32; i += 3)
    *fixture_at(&f, PAGS_SH + (int)(i % 48), i) = i % 2 ? NAN : INFINITY;
  for (int64_t i = 1; i < 32; i += 3)
    *fixture_at(&f, PAGS_SH + (int)(i % 3), i) = -INFINITY;
  engine e = engine_create(2);
  result = fixture_run(&e, &f, 16, 0);
  for (int64_t k = 0; k < 3 * PIXELS; k++)
    assert_true(result.rgb[k] == result.rgb[k]);
  for (int64_t k = 0; k < 32 * PAGS_MAX_PLANES; k++)
    assert_true(isfinite(result.parts[0].planes[k]));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* Pictures smaller than a tile, of one pixel, and far wider than high. */
static void test_odd_sizes(void **state) {
  (void)state;
  const int sizes[5][2] = {{1, 1}, {3, 2}, {16, 16}, {17, 1}, {1, 200}};
  for (int k = 0; k < 5; k++) {
    fixture f = fixture_create(22, 50);
    f.camera.cx *= (double)sizes[k][0] / WIDTH, f.camera.cy *= (double)sizes[k][1] / HEIGHT;
    f.camera.width = sizes[k][0], f.camera.height = sizes[k][1];
    engine e = engine_create(2);
    frame_scene scene = frame_scene_create(&f.part, 1, 64, 0);
    const reference_picture_gradient gradient = {f.weights, NULL, NULL, NULL};
    frame_result result = frame_run(e.frame, &scene, &f.camera, &f.options, &gradient);
    assert_true(frame_result_finite(&result));
    frame_result_destroy(&result);
    frame_scene_destroy(&scene);
    engine_destroy(&e);
    fixture_destroy(&f);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_empty_part),
      cmocka_unit_test(test_nothing_in_view),
      cmocka_unit_test(test_non_finite_rows),
      cmocka_unit_test(test_at_the_camera),
      cmocka_unit_test(test_zero_quaternion),
      cmocka_unit_test(test_quaternion_lengths),
      cmocka_unit_test(test_needle_does_not_flash),
      cmocka_unit_test(test_giants),
      cmocka_unit_test(test_fans_beside_the_picture),
      cmocka_unit_test(test_near_planes),
      cmocka_unit_test(test_clips),
      cmocka_unit_test(test_below_one_level),
      cmocka_unit_test(test_opaque_stacks),
      cmocka_unit_test(test_far_from_the_origin),
      cmocka_unit_test(test_negative_and_nan_colour),
      cmocka_unit_test(test_odd_sizes),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
