/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the gradients of the engine's backward pass (float, SIMD, tiled) with the oracle's for more than ten
 * thousand Gaussians.
 *
 * Boundary band: pixels where the oracle is within a relative 1e-4 of a different decision (alpha at 1/255 or at its
 * cap, transmittance at the early stop, a Gaussian's clamps) or blends neighbours whose depths agree to 1e-6. There
 * float may decide otherwise and give another gradient, so the loss gives such pixels no weight.
 *
 * The error of a Gaussian in a group of planes is |engine - oracle| / max(|oracle|, 1e-2 of the group's root mean
 * square in this scene), with vector norms over the group. */
#include "base/sort.h"
#include "frame_fixture.h"
#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

typedef struct parameter_group {
  const char *name;
  int first, planes; /* planes past the last parameter plane: the statistics of dL/dmean2D */
} parameter_group;

enum { GROUPS = 7, SH_REST = 5, MEAN2D = 6 };
static const parameter_group groups[GROUPS] = {
    {"mean", PAGS_MEAN, 3},
    {"scale", PAGS_SCALE, 3},
    {"rotation", PAGS_ROTATION, 4},
    {"opacity", PAGS_OPACITY, 1},
    {"sh dc", PAGS_SH, 3},
    {"sh rest", PAGS_SH + 3, 45},
    {"mean2d", -1, 1},
};

typedef struct error_list {
  double *values;
  int64_t count;
} error_list;

typedef struct gradient_case {
  const char *name;
  uint64_t seed;
  int count, scenes;
  reference_recipe recipe;
  pags_frame_options options;
  double limit; /* bound on the 99.9th percentile of the error */
  /* 1: two of three rows, the first ones included, are mirrored behind the camera (case 22 of docs/lab/numerics.md). */
  int behind;
  int plain; /* 1: no loss on depth, as in most steps of a training */
  /* 1: a quarter of the rows are dropped, the opacities of the others are raised by up to a third, for some above 1. */
  int dropped;
  /* Not 0: three parts, one of which has separate constant terms, and a sky of this many texels a side. */
  int street;
  int stretched; /* 1: the poses of parts shrink, stretch and mirror */
} gradient_case;

/* Returns the norm of the oracle's gradient of row i in a group. */
static double exact_norm(const reference_part_gradient *gradient, const parameter_group *group, int64_t i) {
  double sum = 0;
  for (int k = 0; k < group->planes; k++) {
    double value = gradient->planes[(group->first + k) * gradient->count + i];
    sum += value * value;
  }
  return sqrt(sum);
}

static double difference_norm(const reference_part_gradient *exact, const frame_part_result *drawn,
                              const parameter_group *group, int64_t i) {
  double sum = 0;
  for (int k = 0; k < group->planes; k++) {
    int64_t at = (group->first + k) * exact->count + i;
    double value = (double)drawn->planes[at] - exact->planes[at];
    sum += value * value;
  }
  return sqrt(sum);
}

/* The densification statistic: norm of dL/dmean2D in NDC units. */
static double exact_mean2d(const double *pixels, const pags_camera *camera, int64_t i) {
  return hypot(pixels[2 * i] * camera->width / 2, pixels[2 * i + 1] * camera->height / 2);
}

static void find_group_errors(const reference_part_gradient *exact, const frame_part_result *drawn,
                              const reference_splat *splats, const pags_camera *camera, int group,
                              const parameter_group *planes, error_list *errors) {
  double *norm = reference_alloc(2 * exact->count, sizeof(double)), *difference = norm + exact->count, square = 0;
  int64_t count = 0;
  for (int64_t i = 0; i < exact->count; i++) {
    if (!splats[i].drawn)
      continue;
    if (group < MEAN2D) {
      norm[i] = exact_norm(exact, planes, i);
      difference[i] = difference_norm(exact, drawn, planes, i);
    } else {
      norm[i] = exact_mean2d(exact->mean2d, camera, i);
      difference[i] = fabs((double)drawn->mean2d[i] - norm[i]);
    }
    square += norm[i] * norm[i];
    count++;
  }
  double floor_norm = 1e-2 * sqrt(square / (double)(count > 0 ? count : 1));
  for (int64_t i = 0; i < exact->count; i++) {
    if (splats[i].drawn && (norm[i] > 0 || difference[i] > 0))
      errors[group].values[errors[group].count++] = difference[i] / fmax(norm[i], floor_norm);
  }
  free(norm);
}

/* Random loss weights in [-1, 1], those of depth in [-1, 1] / 4 m so that depth doesn't dominate, zero where rounding
 * may change a decision. Returns the share of pixels left out. */
static double make_weights(reference_random *random, const reference_picture *picture, double *weights) {
  int64_t pixels = (int64_t)picture->width * picture->height, left_out = 0;
  for (int64_t k = 0; k < pixels; k++) {
    int in_band = picture->margin[k] < 1e-4 || picture->depth_margin[k] < 1e-6;
    left_out += in_band;
    for (int plane = 0; plane < 5; plane++) {
      double value = (double)(float)reference_uniform(random, -1, 1) * (plane == 4 ? 0.25 : 1);
      weights[plane * pixels + k] = in_band ? 0 : value;
    }
  }
  return (double)left_out / (double)pixels;
}

static void mirror_rows(reference_part *part, const pags_camera *camera, const pags_frame_options *options) {
  reference_view view = reference_view_of(part, camera, options);
  for (int64_t i = 0; i < part->count; i++) {
    for (int k = 0; k < 3 && i % 3 < 2; k++) {
      double *mean = &part->planes[(PAGS_MEAN + k) * part->count + i];
      *mean = 2 * view.position[k] - *mean;
    }
  }
}

static void drop_rows(reference_random *random, reference_part *part) {
  part->factor = reference_alloc(part->count, sizeof(double));
  for (int64_t i = 0; i < part->count; i++)
    part->factor[i] = reference_uniform(random, 0, 1) < 0.25 ? 0 : reference_uniform(random, 1, 4.0 / 3);
}

/* Makes a scene of `part_count` parts and a camera that sees about three faces of the sky; returns the oracle's
 * picture. */
static reference_picture make_scene(const gradient_case *c, reference_random *random, pags_camera *camera,
                                    pags_frame_options *options, pags_sky *sky, reference_part *parts, int part_count) {
  static const double stretches[3][3] = {{0.5, 0.5, 0.5}, {-1.5, 0.7, 1.2}, {3, 3, 3}};
  *camera = reference_random_camera(random, 160, 120);
  *options = c->options;
  for (int k = 0; k < 3; k++)
    options->background[k] = (float)reference_uniform(random, 0, 1);
  if (c->street) {
    *sky = reference_random_sky(random, c->street);
    options->sky = sky;
    camera->fx *= 0.5, camera->fy *= 0.5;
  }
  for (int p = 0; p < part_count; p++) {
    parts[p] = reference_part_create(c->count / part_count, p == 2 ? 1 : 3);
    parts[p].first_id = p * (c->count / part_count);
    parts[p].alpha_min =
        p == 1 && !options->antialiased ? (double)(4.0f / 255.0f) : 0; /* a part with another alpha cut */
    reference_random_pose(random, 4, parts[p].world_from_model);
    for (int64_t i = 0; i < parts[p].count; i++)
      reference_random_gaussian(random, &c->recipe, camera, options, &parts[p], i);
    if (c->stretched)
      reference_stretch(&parts[p], stretches[p]);
    if (p == 1)
      reference_random_sh(random, &parts[p]);
    if (c->dropped)
      drop_rows(random, &parts[p]);
    if (c->behind)
      mirror_rows(&parts[p], camera, options);
    frame_scene_round(&parts[p]);
  }
  return reference_render(parts, part_count, camera, options);
}

/* Blocks of the sky that aren't marked as written have no gradient. A camera doesn't see all blocks, except in maps
 * of one or two blocks. */
static void check_blocks(const frame_result *drawn) {
  int64_t marked = 0, blocks = (drawn->sky_floats / 3 + PAGS_SKY_BLOCK - 1) / PAGS_SKY_BLOCK;
  for (int64_t k = 0; k < drawn->sky_floats; k++)
    assert_true(drawn->sky[k] == 0.0f || drawn->sky_blocks[k / 3 / PAGS_SKY_BLOCK]);
  for (int64_t b = 0; b < blocks; b++)
    marked += drawn->sky_blocks[b];
  assert_true(marked > 0 && (marked < blocks || blocks <= 2));
}

/* Compares the sky's gradients, which may differ by rounding only: a texel's gradient is a sum of thousands of terms.
 * Where texels are smaller than pixels it comes from one pixel by that pixel's position between texels, which float
 * gives to 1e-4; most texels then have no gradient, which lowers the floor by a factor of thirty. */
static void check_sky(const frame_result *drawn, const double *exact) {
  const double bound = drawn->sky_floats > 18 * 100 * 100 ? 2e-2 : 1e-3;
  double square = 0, worst = 0;
  for (int64_t k = 0; k < drawn->sky_floats; k++)
    square += exact[k] * exact[k];
  const double floor = 1e-1 * sqrt(square / (double)drawn->sky_floats);
  for (int64_t k = 0; k < drawn->sky_floats; k++)
    worst = fmax(worst, fabs((double)drawn->sky[k] - exact[k]) / fmax(fabs(exact[k]), floor));
  print_message("    sky        %6d, largest %.1e\n", (int)drawn->sky_floats, worst);
  assert_true(square > 0 && worst < bound);
}

static void check_dropped(const reference_part *part, const frame_part_result *drawn) {
  for (int64_t i = 0; part->factor && i < part->count; i++)
    for (int plane = 0; part->factor[i] == 0 && plane < drawn->plane_count; plane++)
      assert_true(!drawn->drawn[i] && drawn->planes[plane * part->count + i] == 0);
}

static void run_scene(const gradient_case *c, uint64_t seed, error_list *errors, double *left_out) {
  reference_random random = {seed};
  pags_camera camera;
  pags_frame_options options;
  pags_sky sky = {0};
  reference_part parts[3];
  const int part_count = c->street ? 3 : 1;
  reference_picture picture = make_scene(c, &random, &camera, &options, &sky, parts, part_count);
  int64_t pixels = (int64_t)camera.width * camera.height;
  double *weights = reference_alloc(5 * pixels, sizeof(double));
  *left_out += make_weights(&random, &picture, weights) / c->scenes;
  double *sky_gradient = reference_alloc(18 * (int64_t)sky.size * sky.size, sizeof(double));
  reference_picture_gradient gradient = {weights, weights + 3 * pixels, c->plain ? NULL : weights + 4 * pixels,
                                         sky_gradient};
  reference_part_gradient exact[3];
  reference_backward(parts, part_count, &camera, &options, &picture, &gradient, exact);
  frame_scene scene = frame_scene_create(parts, part_count, 64, 0);
  frame_result drawn = frame_run(frame, &scene, &camera, &options, &gradient);
  assert_int_equal(drawn.bad_rows, 0);
  assert_true(frame_result_finite(&drawn));
  int64_t first = 0;
  for (int p = 0; p < part_count; first += parts[p++].count) {
    for (int group = 0; group < GROUPS; group++) {
      parameter_group planes = groups[group];
      if (group == SH_REST)
        planes.planes = pags_plane_count(parts[p].sh_degree) - planes.first;
      find_group_errors(&exact[p], &drawn.parts[p], picture.splats + first, &camera, group, &planes, errors);
    }
    check_dropped(&parts[p], &drawn.parts[p]);
  }
  if (c->street) {
    check_sky(&drawn, sky_gradient);
    check_blocks(&drawn);
  }

  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  reference_gradient_destroy(exact, part_count);
  free(weights);
  free(sky_gradient);
  free(sky.texels);
  reference_picture_destroy(&picture);
  for (int p = 0; p < part_count; p++)
    reference_part_destroy(&parts[p]);
}

static void errors_create(error_list *errors, int64_t capacity) {
  for (int group = 0; group < GROUPS; group++)
    errors[group] = (error_list){.values = reference_alloc(capacity, sizeof(double))};
}

static void errors_destroy(error_list *errors) {
  for (int group = 0; group < GROUPS; group++)
    free(errors[group].values);
}

/* Prints each group's percentiles; returns 1 if the 99.9th percentile is below the limit in every group. */
static int judge(error_list *errors, int group_count, double limit) {
  int good = 1;
  for (int group = 0; group < group_count; group++) {
    int64_t count = errors[group].count;
    assert_true(count > 0);
    pags_sort_doubles(errors[group].values, count);
    double median = errors[group].values[count / 2], high = errors[group].values[(count - 1) * 999 / 1000];
    print_message("    %-10s %6d, median %.1e, 99.9 %% %.1e, largest %.1e\n", groups[group].name, (int)count, median,
                  high, errors[group].values[count - 1]);
    good = good && high < limit;
  }
  return good;
}

/* Runs a case, compares it with its own limit, and adds its errors to `pool` unless that is NULL. */
static void run_case(const gradient_case *c, error_list *pool) {
  error_list errors[GROUPS];
  double left_out = 0;
  errors_create(errors, (int64_t)c->count * c->scenes);
  for (int k = 0; k < c->scenes; k++)
    run_scene(c, c->seed + (uint64_t)k, errors, &left_out);
  print_message("  %s: %.1f %% of pixels in the band\n", c->name, 100 * left_out);
  assert_true(left_out < 0.05);
  for (int group = 0; pool && group < GROUPS; group++) {
    int64_t count = errors[group].count;
    memcpy(pool[group].values + pool[group].count, errors[group].values, (size_t)count * sizeof(double));
    pool[group].count += count;
  }
  int good = judge(errors, GROUPS - c->plain, c->limit);
  errors_destroy(errors);
  assert_true(good);
}

/* The engine's stated accuracy: an error below 1e-3 for 99.9 % of more than ten thousand Gaussians of all kinds. Each
 * kind alone has a limit of five times that, since a few thousand Gaussians determine their 99.9th percentile
 * poorly. */
static void test_random_gaussians(void **state) {
  (void)state;
  enum { KINDS = 5, MOST = 20000 };
  const reference_recipe recipe = reference_recipe_default();
  const pags_frame_options options = reference_options();
  gradient_case kinds[KINDS] = {
      {"plain", 100, 1500, 4, recipe, options, .limit = 5e-3},
      {"antialiased", 200, 2500, 2, recipe, options, .limit = 5e-3},
      {"beside the picture", 300, 400, 4, recipe, options, .limit = 5e-3},
      {"opaque", 400, 1000, 2, recipe, options, .limit = 5e-3},
      {"culled in between", 600, 1800, 2, recipe, options, .limit = 5e-3, .behind = 1},
  };
  kinds[1].recipe.sigma[0] = 0.2, kinds[1].recipe.sigma[1] = 3;
  kinds[1].options.antialiased = 1;
  kinds[2].recipe.spread = 2, kinds[2].recipe.sigma[0] = 5, kinds[2].recipe.sigma[1] = 25;
  kinds[3].recipe.logit[0] = 2, kinds[3].recipe.logit[1] = 8;
  error_list pool[GROUPS];
  errors_create(pool, MOST);
  for (int k = 0; k < KINDS; k++)
    run_case(&kinds[k], pool);
  print_message("  all of them:\n");
  for (int group = 0; group < GROUPS; group++)
    assert_true(pool[group].count > 10000);
  int good = judge(pool, GROUPS, 1e-3);
  errors_destroy(pool);
  assert_true(good);
}

/* Tests the code path of the rasteriser's backward pass without depth. */
static void test_plain(void **state) {
  (void)state;
  gradient_case c = {"no depth", 700, 1000, 1, reference_recipe_default(), reference_options(), 5e-3, .plain = 1};
  run_case(&c, NULL);
}

static void test_needles(void **state) {
  (void)state;
  gradient_case c = {"needles", 500, 300, 2, reference_recipe_default(), reference_options(), .limit = 1e-2};
  c.recipe.sigma[0] = 5, c.recipe.sigma[1] = 30, c.recipe.anisotropy = 1e4;
  run_case(&c, NULL);
}

static void test_street(void **state) {
  (void)state;
  gradient_case c = {"sky, parts and another constant term",
                     800,
                     1500,
                     3,
                     reference_recipe_default(),
                     reference_options(),
                     5e-3,
                     .street = 40};
  run_case(&c, NULL);
  c.stretched = 1;
  run_case(&c, NULL);
  c.stretched = 0, c.plain = 1, c.scenes = 1;
  run_case(&c, NULL);
  c.street = 400; /* texels much smaller than pixels */
  run_case(&c, NULL);
  /* The smallest maps: first one with a single texel in all corners of a cell, then the smallest map with real
   * cells. */
  for (c.street = 1, c.scenes = 5; c.street <= 2; c.street++)
    run_case(&c, NULL);
}

/* Dropped rows have no gradient; the gradients of the others include their opacity factor. */
static void test_dropped(void **state) {
  (void)state;
  gradient_case c = {"dropped", 900, 1500, 2, reference_recipe_default(), reference_options(), 5e-3, .dropped = 1};
  run_case(&c, NULL);
  c.name = "dropped, antialiased", c.options.antialiased = 1;
  run_case(&c, NULL);
  c.name = "dropped, beside the picture and opaque", c.options.antialiased = 0, c.count = 400;
  c.recipe.spread = 2, c.recipe.sigma[0] = 5, c.recipe.sigma[1] = 25, c.recipe.logit[0] = 1, c.recipe.logit[1] = 8;
  run_case(&c, NULL);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_random_gaussians), cmocka_unit_test(test_plain),   cmocka_unit_test(test_needles),
      cmocka_unit_test(test_street),           cmocka_unit_test(test_dropped),
  };
  return cmocka_run_group_tests(tests, frame_set_up, frame_tear_down);
}
