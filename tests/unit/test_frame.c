/* One frame and its way back: the same bits for any threads, clusters and order of rows; no heap calls in steady state;
 * and the hard cases of the field's issue trackers that a frame meets: whatever comes in, finite numbers come out. */
#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

enum { WIDTH = 101, HEIGHT = 67, PIXELS = WIDTH * HEIGHT };

/* Fixtures */

typedef struct fixture {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
  double *weights; /* of the loss: five planes */
  float sky_cut;
} fixture;

static fixture fixture_create(uint64_t seed, int64_t count) {
  fixture f = {.random = {seed}, .options = reference_options()};
  f.options.extra_channels = 1;
  f.options.absolute_gradient = 1;
  f.options.background[0] = 0.25f;
  f.options.background[1] = 0.5f;
  f.options.background[2] = 0.75f;
  f.camera = reference_random_camera(&f.random, WIDTH, HEIGHT);
  f.part = reference_part_create(count, 3);
  const reference_recipe recipe = reference_recipe_default();
  for (int64_t i = 0; i < count; i++)
    reference_random_gaussian(&f.random, &recipe, &f.camera, &f.options, &f.part, i);
  f.weights = reference_alloc(5 * PIXELS, sizeof(double));
  for (int k = 0; k < 5 * PIXELS; k++)
    f.weights[k] = reference_uniform(&f.random, -1, 1);
  return f;
}

static void fixture_destroy(fixture *f) {
  reference_part_destroy(&f->part);
  free(f->weights);
}

static double *at(fixture *f, int plane, int64_t i) {
  return &f->part.planes[plane * f->part.count + i];
}

/* A camera at the world's origin looking along z, so that cases can be written in camera space. */
static void camera_at_origin(fixture *f) {
  const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(f->camera.world_from_camera, identity, sizeof identity);
}

static void place(fixture *f, int64_t i, double x, double y, double z, double sigma, double logit) {
  const double values[11] = {x, y, z, log(sigma), log(sigma), log(sigma), 1, 0, 0, 0, logit};
  for (int plane = 0; plane < 11; plane++)
    *at(f, plane, i) = values[plane];
}

typedef struct engine {
  pags_tasks *tasks;
  pags_frame *frame;
} engine;

static engine engine_create(int threads) {
  engine e = {.tasks = pags_tasks_create(threads)};
  assert_non_null(e.tasks);
  assert_int_equal(pags_frame_create(e.tasks, &e.frame), PAGS_OK);
  return e;
}

static void engine_destroy(engine *e) {
  pags_frame_destroy(e->frame);
  pags_tasks_destroy(e->tasks);
}

static frame_result run_with(engine *e, const fixture *f, int cluster_size, uint64_t shuffle_seed) {
  frame_scene scene = frame_scene_create(&f->part, 1, cluster_size, shuffle_seed);
  scene.sky_cut = f->sky_cut;
  const reference_picture_gradient gradient = {f->weights, f->weights + 3 * PIXELS, f->weights + 4 * PIXELS, NULL};
  frame_result result = frame_run(e->frame, &scene, &f->camera, &f->options, &gradient);
  frame_scene_destroy(&scene);
  return result;
}

/* Renders and goes back with two threads; whatever the input, everything that comes out must be finite. */
static frame_result run_finite(const fixture *f) {
  engine e = engine_create(2);
  frame_result result = run_with(&e, f, 16, 0);
  assert_true(frame_result_finite(&result));
  engine_destroy(&e);
  return result;
}

static int is_background(const fixture *f, const frame_result *result) {
  for (int k = 0; k < PIXELS; k++) {
    for (int channel = 0; channel < 3; channel++) {
      if (result->rgb[channel * PIXELS + k] != f->options.background[channel])
        return 0;
    }
    if (result->transmittance[k] != 1 || result->depth[k] != 0 || result->id[k] != -1)
      return 0;
  }
  return 1;
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
  frame_result result = run_finite(f);
  assert_true(is_background(f, &result));
  assert_true(gradient_is_zero(&result));
  frame_result_destroy(&result);
}

/* Determinism */

static uint64_t hash_of(const fixture *f, int threads, int cluster_size, uint64_t shuffle_seed) {
  engine e = engine_create(threads);
  frame_result result = run_with(&e, f, cluster_size, shuffle_seed);
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
  *at(&f, PAGS_OPACITY, 1000) += 0.01; /* the hash sees a change */
  assert_true(hash_of(&f, 1, 64, 0) != expected);
  fixture_destroy(&f);
}

/* A run of texels is one task, whoever takes it: sizes of few and of many runs. */
static void test_threads_change_no_sky(void **state) {
  (void)state;
  const int sizes[] = {1, 30, 250};
  for (int k = 0; k < 3; k++) {
    fixture f = fixture_create(11, 300);
    pags_sky sky = reference_random_sky(&f.random, sizes[k]);
    f.options.sky = &sky;
    f.camera.fx *= 0.3, f.camera.fy *= 0.3;
    reference_random_dc(&f.random, &f.part);
    uint64_t expected = hash_of(&f, 1, 64, 0);
    for (int threads = 2; threads <= 7; threads++)
      assert_true(hash_of(&f, threads, 64, 99) == expected);
    for (int i = 0; i < 18 * sizes[k] * sizes[k]; i++)
      sky.texels[i] += 0.001f;
    assert_true(hash_of(&f, 1, 64, 0) != expected);
    free(sky.texels);
    fixture_destroy(&f);
  }
}

/* Gain and offset come last: over the sky, too, and T, depth and ids stay. */
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

/* Nothing before it: the sky as it is, no background. A map without texels is none. */
static void test_bare_sky(void **state) {
  (void)state;
  fixture f = fixture_create(12, 0);
  pags_sky sky = reference_random_sky(&f.random, 6);
  for (int i = 0; i < 18 * 36; i++)
    sky.texels[i] = i % 3 == 0 ? 0.3f : i % 3 == 1 ? 1.7f : -0.2f; /* not clamped */
  f.options.sky = &sky;
  frame_result result = run_finite(&f);
  for (int k = 0; k < PIXELS; k++) {
    assert_true(fabsf(result.rgb[k] - 0.3f) < 1e-6f);
    assert_true(fabsf(result.rgb[PIXELS + k] - 1.7f) < 1e-6f);
    assert_true(fabsf(result.rgb[2 * PIXELS + k] + 0.2f) < 1e-6f);
    assert_true(result.transmittance[k] == 1);
  }
  frame_result_destroy(&result);
  const pags_sky none = {0};
  f.options.sky = &none;
  result = run_finite(&f);
  assert_true(is_background(&f, &result));
  frame_result_destroy(&result);
  free(sky.texels);
  fixture_destroy(&f);
}

/* A frame shows what pags_sky_sample says, but where rounding may choose the other face. */
static void test_sky_is_the_scene_s(void **state) {
  (void)state;
  fixture f = fixture_create(14, 0);
  pags_sky sky = reference_random_sky(&f.random, 9);
  f.options.sky = &sky;
  f.camera.fx *= 0.3, f.camera.fy *= 0.3;
  frame_result result = run_finite(&f);
  int compared = 0;
  for (int k = 0; k < PIXELS; k++) {
    const double ray[3] = {(k % WIDTH + 0.5 - f.camera.cx) / f.camera.fx, (k / WIDTH + 0.5 - f.camera.cy) / f.camera.fy, 1};
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

/* Pixels whose gradient isn't finite leave no mark on the texels. */
static void test_sky_without_nan(void **state) {
  (void)state;
  fixture f = fixture_create(13, 0);
  pags_sky sky = reference_random_sky(&f.random, 6);
  f.options.sky = &sky;
  for (int k = 0; k < PIXELS; k += 7)
    f.weights[k] = k % 2 ? (double)NAN : (double)INFINITY;
  frame_result result = run_finite(&f);
  double sum = 0;
  for (int64_t k = 0; k < result.sky_floats; k++)
    sum += fabs((double)result.sky[k]);
  assert_true(sum > 1);
  frame_result_destroy(&result);
  free(sky.texels);
  fixture_destroy(&f);
}

/* What is below the cut counts as if it had no gradient. */
static void test_sky_of_pixels_that_show_it(void **state) {
  (void)state;
  fixture f = fixture_create(13, 400);
  pags_sky sky = reference_random_sky(&f.random, 6);
  f.options.sky = &sky;
  frame_result all = run_finite(&f);
  f.sky_cut = 0.5f;
  frame_result cut = run_finite(&f);
  int below = 0;
  for (int k = 0; k < PIXELS; k++) {
    below += all.transmittance[k] < f.sky_cut;
    for (int channel = 0; channel < 3 && all.transmittance[k] < f.sky_cut; channel++)
      f.weights[channel * PIXELS + k] = 0;
  }
  assert_in_range(below, PIXELS / 20, PIXELS * 19 / 20);
  f.sky_cut = 0;
  frame_result masked = run_finite(&f);
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
  for (int64_t i = 0; i < f.part.count; i += 2) { /* half of them out of sight, so that clusters are rejected */
    for (int k = 0; k < 3; k++)
      *at(&f, PAGS_MEAN + k, i) = 2 * f.camera.world_from_camera[4 * k + 3] - *at(&f, PAGS_MEAN + k, i);
  }
  uint64_t expected = hash_of(&f, 2, 64, 0);
  const int sizes[] = {1, 16, 64, 256};
  for (int k = 0; k < 4; k++) {
    assert_true(hash_of(&f, 2, sizes[k], 0) == expected);
    assert_true(hash_of(&f, 2, sizes[k], 77 + (uint64_t)k) == expected);
  }
  fixture_destroy(&f);
}

/* Frames before this one, of other sizes, leave no trace. */
static void test_a_used_frame_is_as_good_as_new(void **state) {
  (void)state;
  fixture f = fixture_create(3, 700), other = fixture_create(4, 1900);
  uint64_t expected = hash_of(&f, 2, 64, 0);
  engine e = engine_create(2);
  for (int round = 0; round < 3; round++) {
    frame_result before = run_with(&e, &other, 16, 0), result = run_with(&e, &f, 64, 0);
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
    frame_result result = run_with(&e, &f, 64, 0);
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

/* Interface */

static void test_statistics(void **state) {
  (void)state;
  fixture f = fixture_create(6, 1000);
  f.options.count_pairs = 1;
  engine e = engine_create(2);
  frame_result result = run_with(&e, &f, 64, 0);
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
  assert_true(is_background(&f, &result));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* Hard cases (facts 6) */

static void test_empty_part(void **state) {
  (void)state;
  fixture f = fixture_create(9, 0);
  expect_nothing_drawn(&f);
  fixture_destroy(&f);
}

/* #13 and #22's extreme: rows exist, none is in view. */
static void test_nothing_in_view(void **state) {
  (void)state;
  fixture f = fixture_create(10, 200);
  camera_at_origin(&f);
  for (int64_t i = 0; i < 200; i++)
    place(&f, i, 0.01 * (double)i, 0, i % 2 ? -3.0 : 0.005, 0.001, 1);
  expect_nothing_drawn(&f);
  for (int64_t i = 0; i < 200; i++) /* in front, far beside */
    place(&f, i, 100 + (double)i, 0, 3, 0.01, 1);
  expect_nothing_drawn(&f);
  fixture_destroy(&f);
}

/* #2: scales whose exponential overflows, and every other parameter that isn't finite. The picture is finite, and where
 * the row can't be drawn its neighbours, of the same vector and cluster, don't notice. (A quaternion that isn't finite
 * may be taken for the identity, as the zero quaternion is.) */
static void test_non_finite_rows(void **state) {
  (void)state;
  fixture f = fixture_create(11, 24);
  const double bad[] = {INFINITY, -INFINITY, NAN, 1e30, -1e30, 100};
  frame_scene_round(&f.part);
  double opacity = *at(&f, PAGS_OPACITY, 5);
  *at(&f, PAGS_OPACITY, 5) = -20;
  frame_result without = run_finite(&f);
  *at(&f, PAGS_OPACITY, 5) = opacity;
  int undrawable = 0;
  for (int plane = 0; plane < PAGS_SH; plane++) {
    double good = *at(&f, plane, 5);
    for (int k = 0; k < 6; k++) {
      *at(&f, plane, 5) = bad[k];
      frame_result result = run_finite(&f);
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
    *at(&f, plane, 5) = good;
  }
  assert_true(undrawable > 20);
  frame_result_destroy(&without);
  fixture_destroy(&f);
}

/* #3: at the camera centre, with z = 0 beside it, and next to it. */
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

/* #5, #6 */
static void test_zero_quaternion(void **state) {
  (void)state;
  fixture f = fixture_create(13, 8);
  frame_result results[2];
  for (int zero = 0; zero < 2; zero++) {
    for (int64_t i = 0; i < 8; i++) {
      for (int k = 0; k < 4; k++)
        *at(&f, PAGS_ROTATION + k, i) = k == 0 && !zero;
    }
    results[zero] = run_finite(&f);
  }
  assert_memory_equal(results[0].rgb, results[1].rgb, 3 * PIXELS * sizeof(float));
  for (int64_t i = 0; i < 4 * 8; i++)
    assert_true(results[1].parts[0].planes[PAGS_ROTATION * 8 + i] == 0);
  frame_result_destroy(&results[0]);
  frame_result_destroy(&results[1]);
  fixture_destroy(&f);
}

/* #7: a needle of 1:1e4 at 45 degrees through the middle covers its line and nothing else. */
static void test_needle_does_not_flash(void **state) {
  (void)state;
  fixture f = fixture_create(14, 1);
  camera_at_origin(&f);
  f.camera.cx = 50.5, f.camera.cy = 33.5, f.camera.fx = f.camera.fy = 90;
  for (int direction = -1; direction <= 1; direction += 2) {
    place(&f, 0, 0, 0, 2, 4e-5, 3);
    *at(&f, PAGS_SCALE, 0) = log(0.4);
    *at(&f, PAGS_ROTATION, 0) = cos(0.39269908169872414);
    *at(&f, PAGS_ROTATION + 3, 0) = direction * sin(0.39269908169872414);
    frame_result result = run_finite(&f);
    int covered = 0;
    for (int k = 0; k < PIXELS; k++) {
      double dx = k % WIDTH + 0.5 - f.camera.cx, dy = k / WIDTH + 0.5 - f.camera.cy;
      double across = fabs(dy - direction * dx) / sqrt(2), along = fabs(dx + direction * dy) / sqrt(2);
      if (across > 1.85) /* sqrt(2 ln(255 o) 0.3) px */
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

/* #8: thousands of pictures wide; costs no more pairs than there are tiles. */
static void test_giants(void **state) {
  (void)state;
  fixture f = fixture_create(15, 4);
  camera_at_origin(&f);
  const double sigmas[4] = {1e3, 1e5, 1e8, 1e12};
  for (int64_t i = 0; i < 4; i++)
    place(&f, i, 0.1, 0.2, 1 + (double)i, sigmas[i], -2);
  engine e = engine_create(2);
  frame_result result = run_with(&e, &f, 16, 0);
  assert_true(frame_result_finite(&result));
  const int64_t tiles = ((WIDTH + 15) / 16) * ((HEIGHT + 15) / 16);
  assert_true(pags_frame_stats_get(e.frame)->pairs_binned <= 4 * tiles);
  assert_true(result.transmittance[0] < 0.9f); /* the smaller ones are drawn, corner to corner */
  assert_true(result.transmittance[PIXELS - 1] < 0.9f);
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* #9: long Gaussians outside of the frustum, close to the camera's plane. Held to the oracle, which holds the
 * definition. */
static void test_fans_beside_the_picture(void **state) {
  (void)state;
  fixture f = fixture_create(16, 24);
  camera_at_origin(&f);
  for (int64_t i = 0; i < 24; i++) {
    double angle = 0.2617993877991494 * (double)i;
    place(&f, i, 1.5 * cos(angle), 1.5 * sin(angle), 0.3 + 0.013 * (double)i, 0.02, 0);
    *at(&f, PAGS_SCALE + 2, i) = log(0.8);
  }
  frame_scene_round(&f.part);
  frame_result result = run_finite(&f);
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

/* #10 */
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
      frame_result result = run_finite(&f);
      assert_int_equal(!is_background(&f, &result), depths[d] > (double)planes[p]);
      assert_int_equal(result.parts[0].drawn[0], depths[d] > (double)planes[p]);
      frame_result_destroy(&result);
    }
  }
  fixture_destroy(&f);
}

/* #12: ln(255 o) is negative. */
static void test_below_one_level(void **state) {
  (void)state;
  fixture f = fixture_create(18, 40);
  for (int64_t i = 0; i < 40; i++)
    *at(&f, PAGS_OPACITY, i) = -5.6 - 0.5 * (double)i; /* 1/255 is at -5.537 */
  engine e = engine_create(1);
  frame_result result = run_with(&e, &f, 16, 0);
  assert_int_equal(pags_frame_stats_get(e.frame)->pairs_binned, 0);
  assert_true(is_background(&f, &result) && gradient_is_zero(&result));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* #15, #16: stacks of the most opaque Gaussians there are: the stop keeps T away from underflow, both ways. */
static void test_opaque_stacks(void **state) {
  (void)state;
  const double logits[5] = {4, 8, 17, 100, 1e30};
  for (int k = 0; k < 5; k++) {
    fixture f = fixture_create(19, 500);
    camera_at_origin(&f);
    for (int64_t i = 0; i < 500; i++)
      place(&f, i, 0, 0, 1 + 0.01 * (double)i, 0.3, logits[k]);
    frame_result result = run_finite(&f);
    for (int pixel = 0; pixel < PIXELS; pixel++)
      assert_true(result.transmittance[pixel] >= 0.9999e-4f && result.transmittance[pixel] <= 1);
    assert_int_equal(result.bad_rows, 0);
    assert_int_equal(result.id[HEIGHT / 2 * WIDTH + WIDTH / 2], 0);
    frame_result_destroy(&result);
    fixture_destroy(&f);
  }
}

/* #18: the same scene a million metres away. */
static void test_far_from_the_origin(void **state) {
  (void)state;
  fixture f = fixture_create(20, 500);
  frame_result here = run_finite(&f);
  for (int k = 0; k < 3; k++) {
    f.options.origin[k] = 1e6 + 12345.678 * k;
    f.camera.world_from_camera[4 * k + 3] += f.options.origin[k];
  }
  frame_result there = run_finite(&f);
  int differ = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    differ += fabsf(here.rgb[k] - there.rgb[k]) > 1e-3f;
  assert_int_equal(differ, 0);
  frame_result_destroy(&here);
  frame_result_destroy(&there);
  fixture_destroy(&f);
}

/* #26: negative colours are clamped, NaN doesn't spread to pixels. */
static void test_negative_and_nan_colour(void **state) {
  (void)state;
  fixture f = fixture_create(21, 32);
  for (int64_t i = 0; i < 32; i++) {
    for (int plane = PAGS_SH; plane < PAGS_MAX_PLANES; plane++)
      *at(&f, plane, i) = plane < PAGS_SH + 3 ? -5 : 0;
  }
  frame_result result = run_finite(&f);
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
    *at(&f, PAGS_SH + (int)(i % 48), i) = i % 2 ? NAN : INFINITY;
  for (int64_t i = 1; i < 32; i += 3)
    *at(&f, PAGS_SH + (int)(i % 3), i) = -INFINITY;
  engine e = engine_create(2);
  result = run_with(&e, &f, 16, 0);
  for (int64_t k = 0; k < 3 * PIXELS; k++)
    assert_true(result.rgb[k] == result.rgb[k]);
  for (int64_t k = 0; k < 32 * PAGS_MAX_PLANES; k++)
    assert_true(isfinite(result.parts[0].planes[k]));
  frame_result_destroy(&result);
  engine_destroy(&e);
  fixture_destroy(&f);
}

/* A picture smaller than a tile, one pixel, and one far longer than high. */
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
      cmocka_unit_test(test_empty_part),
      cmocka_unit_test(test_nothing_in_view),
      cmocka_unit_test(test_non_finite_rows),
      cmocka_unit_test(test_at_the_camera),
      cmocka_unit_test(test_zero_quaternion),
      cmocka_unit_test(test_needle_does_not_flash),
      cmocka_unit_test(test_giants),
      cmocka_unit_test(test_fans_beside_the_picture),
      cmocka_unit_test(test_near_planes),
      cmocka_unit_test(test_below_one_level),
      cmocka_unit_test(test_opaque_stacks),
      cmocka_unit_test(test_far_from_the_origin),
      cmocka_unit_test(test_negative_and_nan_colour),
      cmocka_unit_test(test_odd_sizes),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
