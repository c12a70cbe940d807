/* SPDX-License-Identifier: Apache-2.0 */
/* Tests rolling shutters: the engine's frame and gradients are compared with the oracle. Both are compared with the
 * definition, by which each line is drawn as a separate picture at its read-out time. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

enum { PARTS = 2 };

typedef struct moving {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part parts[PARTS];
} moving;

/* A camera that moves by `speed` metres and turns by a twentieth as many radians during a read-out, in front of
 * standing and moving objects. */
static moving make(uint64_t seed, const char *direction, double speed, int count, int sh_degree,
                   const reference_recipe *recipe) {
  const double seconds = 0.03;
  moving s = {.random = {seed}, .options = reference_options()};
  s.options.extra_channels = 1;
  s.options.background[1] = 0.5f;
  s.camera = reference_random_camera(&s.random, WIDTH, HEIGHT);
  assert_true(pags_shutter_set(&s.camera.shutter, direction, seconds));
  for (int p = 0; p < PARTS; p++) {
    s.parts[p] = reference_part_create(count, sh_degree);
    s.parts[p].first_id = p * count;
    reference_random_pose(&s.random, 3, s.parts[p].world_from_model);
    for (int64_t i = 0; i < count; i++)
      reference_random_gaussian(&s.random, recipe, &s.camera, &s.options, &s.parts[p], i);
    frame_scene_round(&s.parts[p]);
  }
  for (int k = 0; k < 6; k++) {
    const double most = (k < 3 ? 0.05 : 1) * speed / seconds;
    s.camera.shutter.velocity[k] = reference_uniform(&s.random, -most, most);
    s.parts[1].velocity[k] = reference_uniform(&s.random, -most, most);
  }
  return s;
}

static void destroy(moving *s) {
  for (int p = 0; p < PARTS; p++)
    reference_part_destroy(&s->parts[p]);
}

static reference_picture draw_exactly(const moving *s) {
  return reference_render(s->parts, PARTS, &s->camera, &s->options);
}

static frame_result draw(const moving *s, int threads, int cluster_size, uint64_t shuffle_seed) {
  engine e = engine_create(threads);
  frame_scene scene = frame_scene_create(s->parts, PARTS, cluster_size, shuffle_seed);
  frame_result result = frame_run(e.frame, &scene, &s->camera, &s->options, NULL);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  return result;
}

/* The picture by definition. Each line is drawn by the oracle with a global shutter. */
static double *draw_by_lines(const moving *s) {
  double *rgb = reference_alloc(3 * PIXELS, sizeof(double));
  const bool down = s->camera.shutter.down != 0;
  for (int line = 0; line < (down ? HEIGHT : WIDTH); line++) {
    reference_part parts[PARTS];
    reference_moment moment = {0};
    for (int p = 0; p < PARTS; p++) {
      moment = reference_moment_at(&s->parts[p], &s->camera, pags_camera_read_at(&s->camera, line + 0.5, line + 0.5));
      parts[p] = moment.part;
    }
    reference_picture picture = reference_render(parts, PARTS, &moment.camera, &s->options);
    for (int k = 0; k < 3 * PIXELS; k++)
      if ((down ? k % PIXELS / WIDTH : k % WIDTH) == line)
        rgb[k] = picture.rgb[k];
    reference_picture_destroy(&picture);
  }
  return rgb;
}

static double rms(const double *a, const double *b) {
  double sum = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sqrt(sum / (3 * PIXELS));
}

static const char *const directions[] = {"top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left"};

/* ---- Pictures ---- */

/* The engine differs from the oracle by rounding where no decision changes, and by its poses. The oracle's poses are
 * exact, the engine's lie on a parabola through three of them: at 0.02 radians a read-out the error is 1e-7 radians
 * within the picture and 1e-6 outside. 1e-3 is a quarter of a grey level. */
static void test_engine_is_the_oracle(void **state) {
  (void)state;
  const reference_recipe recipe = reference_recipe_default();
  for (int k = 0; k < 16; k++) {
    moving s = make(100 + (uint64_t)k, directions[k % 4], 0.3, 150, 3, &recipe);
    s.options.antialiased = k / 4 % 2;
    pags_sky sky = reference_random_sky(&s.random, 4);
    s.options.sky = k / 8 ? &sky : NULL;
    reference_picture exact = draw_exactly(&s);
    frame_result drawn = draw(&s, 2, 16, (uint64_t)k);
    int compared = 0, held = 0;
    for (int pixel = 0; pixel < PIXELS; pixel++) {
      if (exact.margin[pixel] < 1e-3 || exact.depth_margin[pixel] < 1e-5)
        continue;
      compared++;
      for (int channel = 0; channel < 3; channel++) {
        const double want = exact.rgb[channel * PIXELS + pixel];
        if (!(fabs((double)drawn.rgb[channel * PIXELS + pixel] - want) < 1e-3))
          fail_msg("case %d, pixel %d, %d: %g, should be %g", k, pixel % WIDTH, pixel / WIDTH,
                   (double)drawn.rgb[channel * PIXELS + pixel], want);
      }
      assert_true(fabs((double)drawn.depth[pixel] - exact.depth[pixel]) < 2e-3 * fmax(1, exact.depth[pixel]));
    }
    for (int64_t i = 0; i < exact.splat_count; i++)
      held += exact.splats[i].held;
    assert_true(compared > PIXELS * 3 / 5);
    assert_true(held < 20);
    frame_result_destroy(&drawn);
    reference_picture_destroy(&exact);
    free(sky.texels);
    destroy(&s);
  }
}

/* The error against the picture drawn line by line, as a share of the error of a global shutter. A Gaussian whose
 * lines are read at different times is an ellipse only to first order, so small Gaussians fit best. */
static void test_line_by_line(void **state) {
  (void)state;
  const reference_recipe small = reference_recipe_default();
  for (int k = 0; k < 4; k++) {
    moving s = make(200 + (uint64_t)k, directions[k], 0.15, 100, 1, &small);
    double *truth = draw_by_lines(&s);
    reference_picture exact = draw_exactly(&s);
    moving still = s;
    still.camera.shutter = (pags_shutter){0};
    reference_picture global = draw_exactly(&still);
    const double with = rms(exact.rgb, truth), without = rms(global.rgb, truth);
    print_message("  %-14s error %.5f, with a global shutter %.5f\n", directions[k], with, without);
    assert_true(with < 0.1 * without);

    /* The opposite direction is worse than a global shutter. */
    moving swapped = s;
    swapped.camera.shutter.across *= -1, swapped.camera.shutter.down *= -1;
    reference_picture wrong = draw_exactly(&swapped);
    assert_true(rms(wrong.rgb, truth) > without);
    reference_picture_destroy(&wrong);
    reference_picture_destroy(&global);
    reference_picture_destroy(&exact);
    free(truth);
    destroy(&s);
  }
}

/* Long Gaussians on the ground, more than 64 lines high, under a car at 10 m/s. */
static void test_long_road_gaussians(void **state) {
  (void)state;
  moving s = {.random = {7}, .options = reference_options()};
  s.camera = (pags_camera){.width = WIDTH, .height = HEIGHT, .fx = 800, .fy = 800, .cx = 0.5 * WIDTH, .cy = -87};
  s.camera.world_from_camera[0] = s.camera.world_from_camera[5] = s.camera.world_from_camera[10] = 1;
  pags_shutter_set(&s.camera.shutter, "top_to_bottom", 0.03);
  s.camera.shutter.velocity[1] = 0.3; /* turn in radians a second */
  s.camera.shutter.velocity[5] = 10;
  s.parts[1] = reference_part_create(0, 0);
  s.parts[0] = reference_part_create(9, 0);
  s.parts[0].world_from_model[0] = s.parts[0].world_from_model[5] = s.parts[0].world_from_model[10] = 1;
  for (int i = 0; i < 9; i++) {
    /* Gaussians of a road 1.5 m below: sigmas of 2 cm across, 1 cm up and 1.4 m along. */
    const double values[PAGS_SH + 3] = {
        -0.5 + 0.125 * i, 1.5, 10, log(0.02), log(0.01), log(1.4), 1, 0, 0, 0, 2, 1, 1, 1};
    for (int plane = 0; plane < PAGS_SH + 3; plane++)
      s.parts[0].planes[plane * 9 + i] = values[plane];
  }
  double *truth = draw_by_lines(&s);
  moving still = s;
  still.camera.shutter = (pags_shutter){0};
  reference_picture exact = draw_exactly(&s), global = draw_exactly(&still);
  frame_result drawn = draw(&s, 1, 16, 0);
  double *shown = reference_alloc(3 * PIXELS, sizeof(double));
  for (int k = 0; k < 3 * PIXELS; k++)
    shown[k] = (double)drawn.rgb[k];
  const double with = rms(shown, truth), without = rms(global.rgb, truth);
  print_message("  error %.5f, with a global shutter %.5f\n", with, without);
  assert_true(4 * sqrt(exact.splats[4].cov[2]) > 64); /* height from -2 to 2 sigma in lines */
  assert_true(with < 0.25 * without);
  frame_result_destroy(&drawn);
  reference_picture_destroy(&exact);
  reference_picture_destroy(&global);
  free(shown);
  free(truth);
  destroy(&s);
}

/* Without motion a rolling shutter gives the bits of a global shutter. */
static void test_standing_still(void **state) {
  (void)state;
  const reference_recipe recipe = reference_recipe_default();
  moving s = make(300, "left_to_right", 0, 300, 3, &recipe);
  frame_result rolling = draw(&s, 2, 16, 0);
  s.camera.shutter.across = 0;
  frame_result global = draw(&s, 2, 16, 0);
  assert_true(frame_result_hash(&rolling) == frame_result_hash(&global));
  frame_result_destroy(&rolling);
  frame_result_destroy(&global);
  destroy(&s);
}

/* The number of threads, clusters and their order change no bit, nor does drawing in slabs: clusters are culled by
 * bounds over the whole read-out. Motion is fast, so that Gaussians come into view that aren't in view at mid-exposure;
 * sizes are unequal. */
static void test_bits(void **state) {
  (void)state;
  reference_recipe recipe = reference_recipe_default();
  recipe.spread = 3;
  recipe.sigma[1] = 20;
  for (int k = 0; k < 6; k++) {
    moving s = make(400 + (uint64_t)k, directions[k % 4], k < 3 ? 0.5 : 3, 700, 2, &recipe);
    s.options.early_z = PAGS_EARLY_Z_OFF;
    frame_result first = draw(&s, 1, 16, 0);
    const uint64_t expected = frame_result_hash(&first);
    int shown = 0;
    for (int pixel = 0; pixel < PIXELS; pixel++)
      shown += first.id[pixel] >= 0;
    assert_true(shown > PIXELS / 4);
    frame_result_destroy(&first);
    for (int n = 0; n < 4; n++) {
      const int sizes[] = {256, 64, 16, 32};
      s.options.early_z = n < 2 ? PAGS_EARLY_Z_OFF : PAGS_EARLY_Z_LOSSLESS;
      s.options.slab_size = n < 2 ? 0 : 50 * n;
      frame_result result = draw(&s, n + 1, sizes[n], (uint64_t)n);
      assert_true(frame_result_hash(&result) == expected);
      frame_result_destroy(&result);
    }
    destroy(&s);
  }
}

/* Objects that move along with the read-out, or by more than a pixel a line across it, are drawn at their pose of
 * mid-exposure and counted. */
static void test_held(void **state) {
  (void)state;
  engine e = engine_create(1);
  for (int way = 0; way < 3; way++) {
    moving s = {.random = {7}, .options = reference_options()};
    s.options.extra_channels = 1;
    s.camera =
        (pags_camera){.width = WIDTH, .height = HEIGHT, .fx = 60, .fy = 60, .cx = 0.5 * WIDTH, .cy = 0.5 * HEIGHT};
    s.camera.world_from_camera[0] = s.camera.world_from_camera[5] = s.camera.world_from_camera[10] = 1;
    pags_shutter_set(&s.camera.shutter, "top_to_bottom", 0.1);
    s.parts[1] = reference_part_create(0, 0);
    s.parts[0] = reference_part_create(1, 0);
    memcpy(s.parts[0].world_from_model, s.camera.world_from_camera, sizeof s.parts[0].world_from_model);
    const double values[PAGS_SH + 3] = {0, 0, 6, -1, -1, -1, 1, 0, 0, 0, 2, 1, 1, 1};
    memcpy(s.parts[0].planes, values, sizeof values);
    /* At 10 px a metre, objects move during a read-out by half of the picture's height against its direction, by the
     * height along it, or by more than the height across it. */
    s.parts[0].velocity[way == 2 ? 3 : 4] = (way == 0 ? -0.5 : way == 1 ? 1.0 : 1.2) * 0.1 * HEIGHT / 0.1;
    frame_scene scene = frame_scene_create(s.parts, 1, 16, 0);
    frame_result rolling = frame_run(e.frame, &scene, &s.camera, &s.options, NULL);
    assert_int_equal(pags_frame_stats_get(e.frame)->held, way > 0);
    s.camera.shutter.down = 0;
    frame_result global = frame_run(e.frame, &scene, &s.camera, &s.options, NULL);
    assert_true((frame_result_hash(&rolling) == frame_result_hash(&global)) == (way > 0));
    frame_result_destroy(&rolling);
    frame_result_destroy(&global);
    frame_scene_destroy(&scene);
    destroy(&s);
  }
  engine_destroy(&e);
}

/* ---- Gradients ---- */

static double loss(const moving *s, const double *weights) {
  reference_picture picture = draw_exactly(s);
  double sum = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    sum += weights[k] * picture.rgb[k];
  for (int k = 0; k < PIXELS; k++)
    sum += weights[3 * PIXELS + k] * picture.transmittance[k] + weights[4 * PIXELS + k] * picture.depth_sum[k];
  reference_picture_destroy(&picture);
  return sum;
}

/* Compares the engine's gradients with central differences of the oracle: means, scales, rotations, opacities and
 * colours of standing and moving Gaussians. Pixels at which the oracle decides differently have no weight. */
static void check_gradients(uint64_t seed, const char *direction, bool antialiased) {
  enum { COUNT = 6, DEGREE = 1 };
  const double step = 1e-5;
  reference_recipe recipe = reference_recipe_default();
  recipe.sigma[0] = 3;
  moving s = make(seed, direction, 0.3, COUNT, DEGREE, &recipe);
  s.options.antialiased = antialiased;
  double *weights = reference_alloc(5 * PIXELS, sizeof(double));
  reference_picture picture = draw_exactly(&s);
  int free_pixels = 0;
  for (int k = 0; k < 5 * PIXELS; k++) {
    const bool near = picture.margin[k % PIXELS] < 1e-2 || picture.depth_margin[k % PIXELS] < 1e-3;
    weights[k] = near ? 0 : (double)(float)reference_uniform(&s.random, -1, 1);
    free_pixels += !near;
  }
  assert_true(free_pixels > 5 * PIXELS / 2);
  engine e = engine_create(2);
  frame_scene scene = frame_scene_create(s.parts, PARTS, 16, 0);
  const reference_picture_gradient gradient = {weights, weights + 3 * PIXELS, weights + 4 * PIXELS, NULL};
  frame_result drawn = frame_run(e.frame, &scene, &s.camera, &s.options, &gradient);
  int checked = 0;
  for (int64_t i = 0, all = PARTS * COUNT; i < all; i++) {
    const int p = (int)(i / COUNT);
    reference_part *const part = &s.parts[p];
    if (!picture.splats[i].drawn)
      continue;
    static const int first[] = {PAGS_MEAN,    PAGS_SCALE, PAGS_ROTATION,
                                PAGS_OPACITY, PAGS_SH,    PAGS_SH + 3 * (DEGREE + 1) * (DEGREE + 1)};
    for (int group = 0; group < 5; group++) {
      double norm = 0, off = 0;
      for (int plane = first[group]; plane < first[group + 1]; plane++) {
        double *const value = part->planes + plane * COUNT + i % COUNT, kept = *value, around[4];
        for (int k = 0; k < 4; k++) {
          *value = kept + step * (double)(k < 2 ? k - 2 : k - 1);
          around[k] = loss(&s, weights);
        }
        *value = kept;
        const double want = (8 * (around[2] - around[1]) - (around[3] - around[0])) / (12 * step);
        const double got = (double)drawn.parts[p].planes[plane * COUNT + i % COUNT];
        norm += want * want;
        off += (got - want) * (got - want);
      }
      if (!(sqrt(off) < 2e-3 * sqrt(norm) + 2e-3))
        fail_msg("%s, seed %d, Gaussian %d, planes from %d: off by %g of %g", direction, (int)seed, (int)i,
                 first[group], sqrt(off), sqrt(norm));
      checked += norm > 1e-4;
    }
  }
  assert_true(checked > 20);
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  reference_picture_destroy(&picture);
  free(weights);
  destroy(&s);
}

static void test_gradients(void **state) {
  (void)state;
  for (int k = 0; k < 4; k++)
    check_gradients(500 + (uint64_t)k, directions[k], k % 2);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_engine_is_the_oracle),
      cmocka_unit_test(test_line_by_line),
      cmocka_unit_test(test_long_road_gaussians),
      cmocka_unit_test(test_standing_still),
      cmocka_unit_test(test_bits),
      cmocka_unit_test(test_held),
      cmocka_unit_test(test_gradients),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
