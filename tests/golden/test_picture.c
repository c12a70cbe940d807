/* SPDX-License-Identifier: Apache-2.0 */
/* Compares pictures with known answers: one Gaussian in closed form, crops, and the oracle's pictures.
 *
 * Where the oracle is within a relative 1e-4 of a different decision (1/255, stop, clamps) or blends neighbours whose
 * depths agree to 1e-6, float may decide otherwise. Such pixels form a band with a larger tolerance, and their share is
 * limited. */
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

/* ---- One isotropic Gaussian in front of a camera at the origin, in closed form ---- */

static const pags_camera plain_camera = {.width = 45,
                                         .height = 33,
                                         .fx = 60,
                                         .fy = 50,
                                         .cx = 20.25,
                                         .cy = 18,
                                         .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};

static reference_part single_splat(const double mean[3], double sigma, double opacity, const double colour[3]) {
  reference_part part = reference_part_create(1, 0);
  for (int k = 0; k < 3; k++) {
    part.planes[PAGS_MEAN + k] = mean[k];
    part.planes[PAGS_SCALE + k] = log(sigma);
    part.planes[PAGS_SH + k] = (colour[k] - 0.5) / 0.28209479177387814;
  }
  part.planes[PAGS_ROTATION] = 1;
  part.planes[PAGS_OPACITY] = log(opacity / (1 - opacity));
  frame_scene_round(&part);
  return part;
}

/* With u = x/z, v = y/z the covariance of a ball is sigma^2/z^2 [fx^2 (1+u^2), fx fy u v; ., fy^2 (1+v^2)]. */
static double closed_form_alpha(const pags_camera *camera, const double mean[3], double sigma, double opacity,
                                double low_pass, double px, double py) {
  double z = mean[2], u = mean[0] / z, v = mean[1] / z;
  double s = sigma * sigma / (z * z);
  double xx = s * camera->fx * camera->fx * (1 + u * u) + low_pass;
  double yy = s * camera->fy * camera->fy * (1 + v * v) + low_pass;
  double xy = s * camera->fx * camera->fy * u * v;
  double dx = px - (camera->fx * u + camera->cx), dy = py - (camera->fy * v + camera->cy);
  return opacity * exp(-0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy));
}

static void check_single_splat(const double mean[3], double sigma, double opacity) {
  const double colour[3] = {0.9, 0.4, 0.1};
  reference_part part = single_splat(mean, sigma, opacity, colour);
  pags_frame_options options = reference_options();
  options.extra_channels = 1;
  options.background[2] = 0.75f;
  reference_picture exact = reference_render(&part, 1, &plain_camera, &options);
  frame_scene scene = frame_scene_create(&part, 1, 64, 0);
  frame_result drawn = frame_run(frame, &scene, &plain_camera, &options, NULL);
  int pixels = plain_camera.width * plain_camera.height, blended = 0;
  for (int k = 0; k < pixels; k++) {
    double x = k % plain_camera.width + 0.5, y = k / plain_camera.width + 0.5;
    double alpha = closed_form_alpha(&plain_camera, mean, sigma, opacity, 0.3, x, y);
    if (fabs(alpha * 255 - 1) < 1e-4)
      continue;
    alpha = alpha < 1.0 / 255 ? 0 : fmin(alpha, 0.99);
    blended += alpha > 0;
    for (int channel = 0; channel < 3; channel++) {
      double value = alpha * colour[channel] + (1 - alpha) * (double)options.background[channel];
      assert_true(fabs(exact.rgb[channel * pixels + k] - value) < 1e-6); /* values are rounded to float */
      assert_true(fabs((double)drawn.rgb[channel * pixels + k] - value) < 3e-6);
    }
    assert_true(fabs(exact.transmittance[k] - (1 - alpha)) < 1e-6);
    assert_true(fabs((double)drawn.transmittance[k] - (1 - alpha)) < 3e-6);
    assert_true(fabs((double)drawn.depth[k] - (alpha > 0 ? mean[2] : 0)) < 3e-6 * mean[2]);
    assert_int_equal(drawn.id[k], alpha > 0 ? 0 : -1);
  }
  assert_true(blended > 0);
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  reference_picture_destroy(&exact);
  reference_part_destroy(&part);
}

/* Case 20 of docs/lab/numerics.md: this test finds errors of half a pixel, of an axis or of a factor of two. */
static void test_single_splat(void **state) {
  (void)state;
  check_single_splat((const double[3]){0, 0, 2}, 0.125, 0.8);
  check_single_splat((const double[3]){0.25, -0.125, 1.5}, 0.0625, 0.95);
  check_single_splat((const double[3]){-0.5, 0.375, 2}, 0.25, 0.3);
  check_single_splat((const double[3]){0.0078125, 0.01, 1}, 1e-5, 0.6); /* the low-pass filter sets the size */
  check_single_splat((const double[3]){0, 0, 4}, 0.5, 0.999);           /* alpha is capped */
}

/* ---- Engine against oracle ---- */

typedef struct tolerance {
  double colour, depth; /* largest errors outside of the band; that of depth is relative */
  double band_share;    /* share of pixels that may lie in the band */
} tolerance;

typedef struct comparison {
  double colour, depth, band_colour;
  int64_t in_band, wrong_ids, pixels;
} comparison;

static comparison compare(const reference_picture *exact, const frame_result *drawn) {
  comparison c = {.pixels = (int64_t)exact->width * exact->height};
  for (int64_t k = 0; k < c.pixels; k++) {
    double error = fabs((double)drawn->transmittance[k] - exact->transmittance[k]);
    for (int channel = 0; channel < 3; channel++)
      error = fmax(error, fabs((double)drawn->rgb[channel * c.pixels + k] - exact->rgb[channel * c.pixels + k]));
    assert_true(isfinite(error));
    if (exact->margin[k] < 1e-4 || exact->depth_margin[k] < 1e-6) {
      c.in_band++;
      c.band_colour = fmax(c.band_colour, error);
      continue;
    }
    c.colour = fmax(c.colour, error);
    if (exact->depth[k] > 0)
      c.depth = fmax(c.depth, fabs((double)drawn->depth[k] / exact->depth[k] - 1));
    else
      assert_true(drawn->depth[k] == 0);
    c.wrong_ids += drawn->id[k] != exact->id[k];
  }
  return c;
}

static void check_against_oracle(const char *name, reference_part *parts, int part_count, const pags_camera *camera,
                                 const pags_frame_options *base, tolerance allowed) {
  pags_frame_options options = *base;
  options.extra_channels = 1;
  for (int p = 0; p < part_count; p++)
    frame_scene_round(&parts[p]);
  reference_picture exact = reference_render(parts, part_count, camera, &options);
  frame_scene scene = frame_scene_create(parts, part_count, 64, 0);
  frame_result drawn = frame_run(frame, &scene, camera, &options, NULL);
  comparison c = compare(&exact, &drawn);
  print_message("  %-12s colour %.1e, depth %.1e, %.2f %% of pixels in the band (there %.1e), %d ids differ\n", name,
                c.colour, c.depth, 100 * (double)c.in_band / (double)c.pixels, c.band_colour, (int)c.wrong_ids);
  assert_true(exact.contribution_count > c.pixels / 4);
  assert_true(c.colour < allowed.colour);
  assert_true(c.depth < allowed.depth);
  assert_true((double)c.in_band <= allowed.band_share * (double)c.pixels);
  /* Ids may differ if two weights are equal in float. */
  assert_true((double)c.wrong_ids <= 1e-3 * (double)c.pixels);
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  reference_picture_destroy(&exact);
}

static const tolerance tight = {2e-5, 2e-5, 0.1};

typedef struct picture_case {
  const char *name;
  uint64_t seed;
  int count, width, height;
  reference_recipe recipe;
  pags_frame_options options;
  tolerance allowed;
} picture_case;

static void run_case(const picture_case *c) {
  reference_random random = {c->seed};
  pags_camera camera = reference_random_camera(&random, c->width, c->height);
  pags_frame_options options = c->options;
  for (int k = 0; k < 3; k++)
    options.background[k] = (float)reference_uniform(&random, 0, 1);
  reference_part part = reference_part_create(c->count, 3);
  for (int64_t i = 0; i < c->count; i++)
    reference_random_gaussian(&random, &c->recipe, &camera, &options, &part, i);
  check_against_oracle(c->name, &part, 1, &camera, &options, c->allowed);
  reference_part_destroy(&part);
}

static void test_against_oracle(void **state) {
  (void)state;
  const reference_recipe plain = reference_recipe_default();
  picture_case c = {"plain", 1, 300, 113, 75, plain, reference_options(), tight};
  run_case(&c);
  c.name = "dense", c.count = 3000, c.seed = 2;
  c.allowed.band_share = 0.3;
  run_case(&c);
  c.name = "opaque", c.recipe.logit[0] = 2, c.recipe.logit[1] = 9;
  run_case(&c);
  c = (picture_case){"antialiased", 3, 600, 96, 64, plain, reference_options(), tight};
  c.recipe.sigma[0] = 0.2, c.recipe.sigma[1] = 2;
  c.options.antialiased = 1;
  run_case(&c);
  c = (picture_case){"clamped", 4, 200, 64, 80, plain, reference_options(), tight};
  c.recipe.spread = 3, c.recipe.sigma[0] = 10, c.recipe.sigma[1] = 40;
  run_case(&c);
  c = (picture_case){"needles", 5, 100, 100, 100, plain, reference_options(), {2e-3, 2e-3, 0.2}};
  c.recipe.sigma[0] = 10, c.recipe.sigma[1] = 60, c.recipe.anisotropy = 1e4;
  run_case(&c);
  c = (picture_case){"exp degree 3", 6, 300, 113, 75, plain, reference_options(), {5e-4, 5e-4, 0.1}};
  c.options.exp_degree = 3;
  run_case(&c);
  c = (picture_case){"degree 1", 7, 300, 113, 75, plain, reference_options(), tight};
  c.options.sh_degree = 1;
  run_case(&c);
}

/* Two rigid parts, with the scene's origin and the camera a million metres away (case 18 of docs/lab/numerics.md). */
static void test_parts_far_from_zero(void **state) {
  (void)state;
  reference_random random = {8};
  pags_camera camera = reference_random_camera(&random, 96, 72);
  pags_frame_options options = reference_options();
  const double origin[3] = {1e6, -4e6, 5e5};
  for (int k = 0; k < 3; k++) {
    options.origin[k] = origin[k];
    camera.world_from_camera[4 * k + 3] += origin[k];
  }
  reference_part parts[2] = {reference_part_create(150, 3), reference_part_create(170, 1)};
  parts[1].first_id = 150;
  const reference_recipe recipe = reference_recipe_default();
  for (int p = 0; p < 2; p++) {
    reference_random_pose(&random, 5, parts[p].world_from_model);
    for (int64_t i = 0; i < parts[p].count; i++)
      reference_random_gaussian(&random, &recipe, &camera, &options, &parts[p], i);
  }
  /* Means are up to 15 m from the parts' origins: their rounding of 1e-6 m is 1e-4 px at a depth of 1 m. */
  const tolerance far = {4e-5, 1e-4, 0.1};
  check_against_oracle("two parts", parts, 2, &camera, &options, far);
  reference_part_destroy(&parts[0]);
  reference_part_destroy(&parts[1]);
}

/* Scaled, stretched and mirrored poses change covariances and the directions of colours. The clusters' bounds must
 * follow. */
static void test_affine_poses(void **state) {
  (void)state;
  static const double stretches[3][3] = {{0.4, 0.4, 0.4}, {2, 0.7, 1.3}, {-1.5, 1.5, 1.5}};
  reference_random random = {12};
  const pags_camera camera = reference_random_camera(&random, 96, 72);
  const pags_frame_options options = reference_options();
  const reference_recipe recipe = reference_recipe_default();
  reference_part parts[3];
  for (int p = 0; p < 3; p++) {
    parts[p] = reference_part_create(200, 3);
    parts[p].first_id = 200 * p;
    reference_random_pose(&random, 5, parts[p].world_from_model);
    for (int64_t i = 0; i < parts[p].count; i++)
      reference_random_gaussian(&random, &recipe, &camera, &options, &parts[p], i);
    /* Stretches along the camera's axes, so that most visible Gaussians stay visible. */
    const double *const s = stretches[p], stretch[12] = {s[0], 0, 0, 0, 0, s[1], 0, 0, 0, 0, s[2], 0};
    double local[12], back[12], *const m = parts[p].world_from_model;
    memcpy(local, camera.world_from_camera, sizeof local);
    for (int k = 0; k < 3; k++)
      local[4 * k + 3] -= options.origin[k];
    pags_rigid_inverse(local, back);
    pags_rigid_multiply(local, stretch, local);
    pags_rigid_multiply(local, back, local);
    pags_rigid_multiply(local, m, m);
  }
  const tolerance bent = {4e-5, 1e-4,
                          0.1}; /* tolerances as for parts far from zero, since means have the same rounding */
  check_against_oracle("affine poses", parts, 3, &camera, &options, bent);
  for (int p = 0; p < 3; p++)
    reference_part_destroy(&parts[p]);

  /* A Gaussian outside of the picture reaches into it because its pose enlarges it: the cluster's sigma must grow as
   * well. */
  reference_part beside = single_splat((const double[3]){0.2, 0, 0.25}, 0.1, 0.9, (const double[3]){0.9, 0.4, 0.1});
  for (int k = 0; k < 3; k++)
    beside.world_from_model[5 * k] = 8;
  check_against_oracle("beside", &beside, 1, &plain_camera, &options, bent);
  reference_part_destroy(&beside);
}

/* Case 21 of docs/lab/numerics.md: a window of a picture equals the picture of a camera with a shifted principal
 * point. The means stay within the window, as the clamp of the Jacobian depends on the picture's size. */
static void test_crop(void **state) {
  (void)state;
  enum { X0 = 23, Y0 = 17, WIDTH = 51, HEIGHT = 38 };
  reference_random random = {9};
  pags_camera full = reference_random_camera(&random, 120, 90), crop = full;
  crop.width = WIDTH, crop.height = HEIGHT, crop.cx -= X0, crop.cy -= Y0;
  pags_frame_options options = reference_options();
  reference_part part = reference_part_create(200, 3);
  const reference_recipe recipe = reference_recipe_default();
  for (int64_t i = 0; i < part.count; i++)
    reference_random_gaussian(&random, &recipe, &crop, &options, &part, i);
  frame_scene_round(&part);

  reference_picture exact_full = reference_render(&part, 1, &full, &options);
  reference_picture exact_crop = reference_render(&part, 1, &crop, &options);
  frame_scene scene = frame_scene_create(&part, 1, 16, 0);
  frame_result drawn_full = frame_run(frame, &scene, &full, &options, NULL);
  frame_result drawn_crop = frame_run(frame, &scene, &crop, &options, NULL);
  for (int k = 0; k < WIDTH * HEIGHT; k++) {
    int at = (k / WIDTH + Y0) * full.width + k % WIDTH + X0;
    for (int channel = 0; channel < 3; channel++) {
      int in_crop = channel * WIDTH * HEIGHT + k, in_full = channel * full.width * full.height + at;
      assert_true(fabs(exact_crop.rgb[in_crop] - exact_full.rgb[in_full]) < 1e-9);
      if (exact_crop.margin[k] > 1e-4 && exact_crop.depth_margin[k] > 1e-6)
        assert_true(fabsf(drawn_crop.rgb[in_crop] - drawn_full.rgb[in_full]) < 2e-5f);
    }
  }
  frame_result_destroy(&drawn_full);
  frame_result_destroy(&drawn_crop);
  frame_scene_destroy(&scene);
  reference_picture_destroy(&exact_full);
  reference_picture_destroy(&exact_crop);
  reference_part_destroy(&part);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_single_splat),
      cmocka_unit_test(test_against_oracle),
      cmocka_unit_test(test_parts_far_from_zero),
      cmocka_unit_test(test_affine_poses),
      cmocka_unit_test(test_crop),
  };
  return cmocka_run_group_tests(tests, frame_set_up, frame_tear_down);
}
