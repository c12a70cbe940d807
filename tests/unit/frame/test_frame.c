/* SPDX-License-Identifier: Apache-2.0 */
/* Tests a frame's forward and backward pass: the same bits for any number of threads, cluster size and order of
 * rows; no heap calls in steady state; the sky behind the Gaussians. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

/* ---- Determinism ---- */

static uint64_t hash_of(const fixture *f, int threads, int cluster_size, uint64_t shuffle_seed) {
  engine e = engine_create(threads);
  frame_result result = fixture_run(&e, f, cluster_size, shuffle_seed);
  uint64_t hash = frame_result_hash(&result);
  frame_result_destroy(&result);
  engine_destroy(&e);
  return hash;
}

static void test_threads_change_nothing(void **state) {
  (void)state;
  fixture f = fixture_create(1, 2000);
  uint64_t expected = hash_of(&f, 1, 64, 0);
  for (int threads = 2; threads <= 8; threads++)
    assert_true(hash_of(&f, threads, 64, 0) == expected);
  *fixture_at(&f, PAGS_OPACITY, 1000) += 0.01; /* the hash depends on every parameter */
  assert_true(hash_of(&f, 1, 64, 0) != expected);
  fixture_destroy(&f);
}

/* The sky's gradient is reduced in runs of texels, one task each, in the order of the tiles. The number of threads
 * changes no bit, with few and with many runs. */
static void test_threads_change_no_sky(void **state) {
  (void)state;
  const int sizes[] = {1, 30, 250};
  for (int k = 0; k < 3; k++) {
    fixture f = fixture_create(11, 300);
    pags_sky sky = reference_random_sky(&f.random, sizes[k]);
    f.options.sky = &sky;
    f.camera.fx *= 0.3, f.camera.fy *= 0.3;
    reference_random_sh(&f.random, &f.part);
    uint64_t expected = hash_of(&f, 1, 64, 0);
    for (int threads = 2; threads <= 7; threads++)
      assert_true(hash_of(&f, threads, 64, 99) == expected);
    assert_true(hash_of(&f, 9, 64, 99) == expected); /* from 9 threads on there are more and smaller runs */
    for (int i = 0; i < 18 * sizes[k] * sizes[k]; i++)
      sky.texels[i] += 0.001f;
    assert_true(hash_of(&f, 1, 64, 0) != expected);
    free(sky.texels);
    fixture_destroy(&f);
  }
}

/* Exposure (gain and offset) is applied last, over the sky as well; transmittance, depth and ids don't change. */
static void test_exposure(void **state) {
  (void)state;
  fixture f = fixture_create(12, 300);
  pags_sky sky = reference_random_sky(&f.random, 8);
  engine e = engine_create(2);
  frame_scene scene = frame_scene_create(&f.part, 1, 16, 0);
  f.options.sky = &sky;
  frame_result plain = frame_run(e.frame, &scene, &f.camera, &f.options, NULL);
  assert_false(pags_frame_options_expose(&f.options, (double[]){1, 1, 1}, (double[]){0, 0, 0}));
  assert_true(pags_frame_options_expose(&f.options, (double[]){1.25, 0.5, 1}, (double[]){0.125, 0, -0.25}));
  frame_result shown = frame_run(e.frame, &scene, &f.camera, &f.options, NULL);
  for (int channel = 0; channel < 3; channel++)
    for (int k = channel * PIXELS; k < (channel + 1) * PIXELS; k++)
      assert_true(fabsf(shown.rgb[k] - (f.options.gain[channel] * plain.rgb[k] + f.options.offset[channel])) < 1e-6f);
  assert_memory_equal(shown.transmittance, plain.transmittance, PIXELS * sizeof *plain.transmittance);
  assert_memory_equal(shown.id, plain.id, PIXELS * sizeof *plain.id);
  frame_result_destroy(&plain);
  frame_result_destroy(&shown);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  free(sky.texels);
  fixture_destroy(&f);
}

/* Without Gaussians the picture shows the sky's values unchanged, not the background colour. A map without texels
 * counts as no sky. */
static void test_bare_sky(void **state) {
  (void)state;
  fixture f = fixture_create(12, 0);
  pags_sky sky = reference_random_sky(&f.random, 6);
  for (int i = 0; i < 18 * 36; i++)
    sky.texels[i] = i % 3 == 0 ? 0.3f : i % 3 == 1 ? 1.7f : -0.2f; /* sky values aren't clamped */
  f.options.sky = &sky;
  frame_result result = fixture_run_finite(&f);
  for (int k = 0; k < PIXELS; k++) {
    assert_true(fabsf(result.rgb[k] - 0.3f) < 1e-6f);
    assert_true(fabsf(result.rgb[PIXELS + k] - 1.7f) < 1e-6f);
    assert_true(fabsf(result.rgb[2 * PIXELS + k] + 0.2f) < 1e-6f);
    assert_true(result.transmittance[k] == 1);
  }
  frame_result_destroy(&result);
  const pags_sky none = {0};
  f.options.sky = &none;
  result = fixture_run_finite(&f);
  assert_true(fixture_is_background(&f, &result));
  frame_result_destroy(&result);
  free(sky.texels);
  fixture_destroy(&f);
}

/* A frame shows the colours that pags_sky_sample gives, except at directions where rounding may choose the other cube
 * face. */
static void test_sky_is_the_scene_s(void **state) {
  (void)state;
  fixture f = fixture_create(14, 0);
  pags_sky sky = reference_random_sky(&f.random, 9);
  f.options.sky = &sky;
  f.camera.fx *= 0.3, f.camera.fy *= 0.3;
  frame_result result = fixture_run_finite(&f);
  int compared = 0;
  for (int k = 0; k < PIXELS; k++) {
    const double ray[3] = {(k % WIDTH + 0.5 - f.camera.cx) / f.camera.fx, (k / WIDTH + 0.5 - f.camera.cy) / f.camera.fy,
                           1};
    double direction[3], margin = 1;
    for (int axis = 0; axis < 3; axis++) {
      const double *r = f.camera.world_from_camera + 4 * axis;
      direction[axis] = r[0] * ray[0] + r[1] * ray[1] + r[2] * ray[2];
    }
    for (int axis = 0; axis < 3; axis++)
      margin = fmin(margin, fabs(fabs(direction[axis]) / fmax(fabs(direction[(axis + 1) % 3]), 1e-9) - 1));
    float rgb[3];
    pags_sky_sample(&sky, direction, rgb);
    compared += margin > 1e-5;
    for (int channel = 0; channel < 3 && margin > 1e-5; channel++)
      assert_true(fabsf(result.rgb[channel * PIXELS + k] - rgb[channel]) < 2e-5f);
  }
  assert_true(compared > PIXELS * 9 / 10);
  frame_result_destroy(&result);
  free(sky.texels);
  fixture_destroy(&f);
}

/* Pixels whose gradient isn't finite add nothing to the texels' gradient. */
static void test_sky_without_nan(void **state) {
  (void)state;
  fixture f = fixture_create(13, 0);
  pags_sky sky = reference_random_sky(&f.random, 6);
  f.options.sky = &sky;
  for (int k = 0; k < PIXELS; k += 7)
    f.weights[k] = k % 2 ? (double)NAN : (double)INFINITY;
  frame_result result = fixture_run_finite(&f);
  double sum = 0;
  for (int64_t k = 0; k < result.sky_floats; k++)
    sum += fabs((double)result.sky[k]);
  assert_true(sum > 1);
  frame_result_destroy(&result);
  free(sky.texels);
  fixture_destroy(&f);
}

/* Pixels whose transmittance is below sky_cut add nothing to the texels' gradient. */
static void test_sky_of_pixels_that_show_it(void **state) {
  (void)state;
  fixture f = fixture_create(13, 400);
  pags_sky sky = reference_random_sky(&f.random, 6);
  f.options.sky = &sky;
  frame_result all = fixture_run_finite(&f);
  f.sky_cut = 0.5f;
  frame_result cut = fixture_run_finite(&f);
  int below = 0;
  for (int k = 0; k < PIXELS; k++) {
    below += all.transmittance[k] < f.sky_cut;
    for (int channel = 0; channel < 3 && all.transmittance[k] < f.sky_cut; channel++)
      f.weights[channel * PIXELS + k] = 0;
  }
  assert_in_range(below, PIXELS / 20, PIXELS * 19 / 20);
  f.sky_cut = 0;
  frame_result masked = fixture_run_finite(&f);
  assert_memory_equal(cut.sky, masked.sky, (size_t)all.sky_floats * sizeof(float));
  assert_memory_not_equal(cut.sky, all.sky, (size_t)all.sky_floats * sizeof(float));
  frame_result_destroy(&all);
  frame_result_destroy(&cut);
  frame_result_destroy(&masked);
  free(sky.texels);
  fixture_destroy(&f);
}

static void test_clusters_and_order_change_nothing(void **state) {
  (void)state;
  fixture f = fixture_create(2, 1500);
  /* Half of the rows are moved out of view so that clusters are rejected. */
  for (int64_t i = 0; i < f.part.count; i += 2) {
    for (int k = 0; k < 3; k++)
      *fixture_at(&f, PAGS_MEAN + k, i) = 2 * f.camera.world_from_camera[4 * k + 3] - *fixture_at(&f, PAGS_MEAN + k, i);
  }
  uint64_t expected = hash_of(&f, 2, 64, 0);
  const int sizes[] = {16, 48, 64, 256};
  for (int k = 0; k < 4; k++) {
    assert_true(hash_of(&f, 2, sizes[k], 0) == expected);
    assert_true(hash_of(&f, 2, sizes[k], 77 + (uint64_t)k) == expected);
  }
  const int refused[] = {0, 1, 8, 17, 272};
  for (int k = 0; k < 5; k++) {
    pags_clusters clusters;
    assert_int_equal(pags_clusters_create(&clusters, 100, refused[k]), PAGS_ERROR_ARGUMENT);
  }
  fixture_destroy(&f);
}

/* A frame object that has drawn pictures of other sizes gives the bits of a new one. */
static void test_a_used_frame_is_as_good_as_new(void **state) {
  (void)state;
  fixture f = fixture_create(3, 700), other = fixture_create(4, 1900);
  uint64_t expected = hash_of(&f, 2, 64, 0);
  engine e = engine_create(2);
  for (int round = 0; round < 3; round++) {
    frame_result before = fixture_run(&e, &other, 16, 0), result = fixture_run(&e, &f, 64, 0);
    assert_true(frame_result_hash(&result) == expected);
    frame_result_destroy(&before);
    frame_result_destroy(&result);
  }
  engine_destroy(&e);
  fixture_destroy(&f);
  fixture_destroy(&other);
}

static void test_steady_state_makes_no_heap_call(void **state) {
  (void)state;
  fixture f = fixture_create(5, 3000);
  engine e = engine_create(3);
  uint64_t calls = 0;
  for (int round = 1; round <= 8; round++) {
    frame_result result = fixture_run(&e, &f, 64, 0);
    frame_result_destroy(&result);
    if (round > 3)
      assert_int_equal(pags_frame_heap_calls(e.frame), calls);
    calls = pags_frame_heap_calls(e.frame);
  }
  assert_true(calls > 0);
  assert_true(pags_frame_bytes(e.frame) > 0);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* ---- Interface ---- */

static void test_statistics(void **state) {
  (void)state;
  fixture f = fixture_create(6, 1000);
  f.options.count_pairs = 1;
  engine e = engine_create(2);
  frame_result result = fixture_run(&e, &f, 64, 0);
  const pags_frame_stats *stats = pags_frame_stats_get(e.frame);
  frame_scene_round(&f.part);
  reference_picture exact = reference_render(&f.part, 1, &f.camera, &f.options);
  assert_int_equal(stats->gaussians, 1000);
  assert_true(stats->loaded <= 1000 && stats->loaded >= stats->shaded && stats->shaded >= stats->binned);
  assert_true(stats->pairs_binned >= stats->binned && stats->pairs_evaluated >= stats->pairs_blended);
  double blended = (double)stats->pairs_blended, expected = (double)exact.contribution_count;
  assert_true(fabs(blended / expected - 1) < 1e-3);
  reference_picture_destroy(&exact);
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

static void test_cancelled(void **state) {
  (void)state;
  fixture f = fixture_create(7, 100);
  engine e = engine_create(2);
  frame_scene scene = frame_scene_create(&f.part, 1, 64, 0);
  scene.parts[0].gaussians = &scene.gaussians[0];
  scene.parts[0].clusters = &scene.clusters[0];
  pags_picture picture;
  pags_tasks_cancel(e.tasks);
  assert_int_equal(pags_frame_render(e.frame, scene.parts, 1, &f.camera, &f.options, NULL, NULL, &picture),
                   PAGS_CANCELLED);
  pags_tasks_reset(e.tasks);
  assert_int_equal(pags_frame_render(e.frame, scene.parts, 1, &f.camera, &f.options, NULL, NULL, &picture), PAGS_OK);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  fixture_destroy(&f);
}

static void test_no_parts(void **state) {
  (void)state;
  fixture f = fixture_create(8, 0);
  engine e = engine_create(2);
  const frame_scene nothing = {0};
  const reference_picture_gradient gradient = {f.weights, NULL, NULL, NULL};
  frame_result result = frame_run(e.frame, &nothing, &f.camera, &f.options, &gradient);
  assert_true(fixture_is_background(&f, &result));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_threads_change_no_sky),
      cmocka_unit_test(test_exposure),
      cmocka_unit_test(test_bare_sky),
      cmocka_unit_test(test_sky_is_the_scene_s),
      cmocka_unit_test(test_sky_without_nan),
      cmocka_unit_test(test_sky_of_pixels_that_show_it),
      cmocka_unit_test(test_threads_change_nothing),
      cmocka_unit_test(test_clusters_and_order_change_nothing),
      cmocka_unit_test(test_a_used_frame_is_as_good_as_new),
      cmocka_unit_test(test_steady_state_makes_no_heap_call),
      cmocka_unit_test(test_statistics),
      cmocka_unit_test(test_cancelled),
      cmocka_unit_test(test_no_parts),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
