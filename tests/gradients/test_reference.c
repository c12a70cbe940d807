/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the oracle's gradient with finite differences of the oracle's picture, parameter by parameter.
 *
 * The loss has a fixed random weight on every channel of every pixel. Differences are five-point stencils. They are
 * taken for each pixel before they are summed, so that unchanged pixels cost no digits. If a point of the stencil
 * decides differently from the base point (contributor, cap, clamp, order), the loss isn't smooth and the parameter is
 * left out. Each test limits the share of such parameters. */
#include "reference/reference.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

enum { MAX_PARTS = 2, WIDTH = 36, HEIGHT = 28 };

typedef struct test_scene {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part parts[MAX_PARTS];
  int part_count;
  pags_sky sky;    /* size 0: no sky */
  double step;     /* step of the differences: in pixels for means, else in units of the parameter */
  double *weights; /* rgb, transmittance, depth_sum: five planes */
} test_scene;

static test_scene scene_create(uint64_t seed, int64_t count, int sh_degree) {
  test_scene scene = {.random = {seed}, .options = reference_options(), .part_count = 1, .step = 2e-5};
  scene.camera = reference_random_camera(&scene.random, WIDTH, HEIGHT);
  for (int k = 0; k < 3; k++)
    scene.options.background[k] = (float)reference_uniform(&scene.random, 0, 1);
  scene.parts[0] = reference_part_create(count, sh_degree);
  scene.weights = reference_alloc((int64_t)5 * WIDTH * HEIGHT, sizeof(double));
  for (int k = 0; k < 5 * WIDTH * HEIGHT; k++)
    scene.weights[k] = reference_uniform(&scene.random, -1, 1);
  return scene;
}

static void scene_destroy(test_scene *scene) {
  for (int p = 0; p < scene->part_count; p++)
    reference_part_destroy(&scene->parts[p]);
  free(scene->sky.texels);
  free(scene->weights);
}

static void scene_fill(test_scene *scene, const reference_recipe *recipe) {
  for (int p = 0; p < scene->part_count; p++) {
    for (int64_t i = 0; i < scene->parts[p].count; i++)
      reference_random_gaussian(&scene->random, recipe, &scene->camera, &scene->options, &scene->parts[p], i);
  }
}

static reference_picture scene_render(const test_scene *scene) {
  pags_frame_options options = scene->options;
  options.sky = scene->sky.size ? &scene->sky : NULL;
  return reference_render(scene->parts, scene->part_count, &scene->camera, &options);
}

static double loss_difference(const test_scene *scene, const reference_picture *a, const reference_picture *b) {
  const double *w = scene->weights;
  const int64_t pixels = WIDTH * HEIGHT;
  double sum = 0;
  for (int64_t k = 0; k < pixels; k++) {
    for (int channel = 0; channel < 3; channel++)
      sum += w[channel * pixels + k] * (a->rgb[channel * pixels + k] - b->rgb[channel * pixels + k]);
    sum += w[3 * pixels + k] * (a->transmittance[k] - b->transmittance[k]);
    sum += w[4 * pixels + k] * (a->depth_sum[k] - b->depth_sum[k]);
  }
  return sum;
}

/* Returns the derivative of the loss by *value; *smooth is 0 if a point of the stencil crosses a decision. */
static double finite_difference(const test_scene *scene, double *value, double step, uint64_t decisions, int *smooth) {
  double base = *value, difference[2];
  *smooth = 1;
  for (int k = 0; k < 2; k++) {
    *value = base + (k + 1) * step;
    reference_picture above = scene_render(scene);
    *value = base - (k + 1) * step;
    reference_picture below = scene_render(scene);
    *smooth = *smooth && above.decisions == decisions && below.decisions == decisions;
    difference[k] = loss_difference(scene, &above, &below);
    reference_picture_destroy(&above);
    reference_picture_destroy(&below);
  }
  *value = base;
  return (8 * difference[0] - difference[1]) / (12 * step);
}

static void scene_backward(const test_scene *scene, const reference_picture *picture, reference_part_gradient *out,
                           double *sky) {
  const int64_t pixels = WIDTH * HEIGHT;
  reference_picture_gradient gradient = {scene->weights, scene->weights + 3 * pixels, scene->weights + 4 * pixels, sky};
  pags_frame_options options = scene->options;
  options.sky = scene->sky.size ? &scene->sky : NULL;
  reference_backward(scene->parts, scene->part_count, &scene->camera, &options, picture, &gradient, out);
}

/* Compares every parameter; at most `skip_share` of the parameters of drawn Gaussians may be at a non-smooth point. */
static void check_gradient(test_scene *scene, double skip_share) {
  reference_picture picture = scene_render(scene);
  reference_part_gradient gradient[MAX_PARTS];
  scene_backward(scene, &picture, gradient, NULL);
  int64_t compared = 0, skipped = 0, splat = 0;
  double worst = 0;
  for (int p = 0; p < scene->part_count; p++) {
    reference_part *part = &scene->parts[p];
    for (int64_t i = 0; i < part->count; i++, splat++) {
      for (int plane = 0; plane < pags_plane_count(part->sh_degree); plane++) {
        double analytic = gradient[p].planes[plane * part->count + i];
        if (!picture.splats[splat].drawn) {
          assert_true(analytic == 0);
          continue;
        }
        /* Size of a pixel in metres at this depth. */
        double pixel = picture.splats[splat].camera[2] / scene->camera.fx;
        double step = scene->step * (plane < PAGS_SCALE ? pixel : 1);
        int smooth;
        double *at = &part->planes[plane * part->count + i];
        if (part->sh && plane >= PAGS_SH) /* replaces the row's */
          at = &part->sh[(plane - PAGS_SH) * part->count + i];
        double numeric = finite_difference(scene, at, step, picture.decisions, &smooth);
        compared += smooth;
        skipped += !smooth;
        /* The floor of `scale` is the rounding of the difference, far below any relevant gradient. */
        double scale = fmax(fabs(analytic), fabs(numeric)) + 1e-3 / (plane < PAGS_SCALE ? pixel : 1);
        double error = smooth ? fabs(analytic - numeric) / scale : 0;
        if (error > 1e-6)
          print_error("part %d Gaussian %d plane %d: analytic %.12g, numeric %.12g\n", p, (int)i, plane, analytic,
                      numeric);
        assert_true(error <= 1e-6);
        worst = fmax(worst, error);
      }
    }
  }
  print_message("  %d compared, %d skipped, worst relative error %.2g\n", (int)compared, (int)skipped, worst);
  assert_true(compared > 0);
  assert_true((double)skipped <= skip_share * (double)(compared + skipped));
  reference_gradient_destroy(gradient, scene->part_count);
  reference_picture_destroy(&picture);
}

static int64_t count_drawn(const test_scene *scene) {
  reference_picture picture = scene_render(scene);
  int64_t drawn = 0;
  for (int64_t k = 0; k < picture.splat_count; k++)
    drawn += picture.splats[k].drawn;
  reference_picture_destroy(&picture);
  return drawn;
}

static void test_anisotropic_off_axis(void **state) {
  (void)state;
  for (uint64_t seed = 1; seed <= 3; seed++) {
    test_scene scene = scene_create(seed, 10, 3);
    reference_recipe recipe = reference_recipe_default();
    recipe.anisotropy = 30;
    scene_fill(&scene, &recipe);
    scene.camera.cx += 9; /* the principal point is far from the picture's centre */
    scene.camera.cy -= 7;
    check_gradient(&scene, 0.05);
    scene_destroy(&scene);
  }
}

/* Tests means outside of the widened picture whose ellipses reach into it. */
static void test_clamped_jacobian(void **state) {
  (void)state;
  test_scene scene = scene_create(11, 16, 0);
  reference_recipe recipe = reference_recipe_default();
  recipe.spread = 2.5;
  recipe.sigma[0] = 12;
  recipe.sigma[1] = 20;
  recipe.anisotropy = 3;
  scene_fill(&scene, &recipe);
  reference_picture picture = scene_render(&scene);
  int clamped = 0;
  for (int64_t k = 0; k < picture.contribution_count; k++) {
    const reference_splat *splat = &picture.splats[picture.contributions[k].gaussian];
    clamped += splat->clamped_axis[0] != 0 || splat->clamped_axis[1] != 0;
  }
  assert_true(clamped > 1000);
  reference_picture_destroy(&picture);
  check_gradient(&scene, 0.3); /* ellipses as large as the picture have more pixels at the cut-off */
  scene_destroy(&scene);
}

/* Case 22 of docs/lab/numerics.md: rows that aren't drawn come before, between and after drawn ones. */
static void test_culled_in_front(void **state) {
  (void)state;
  test_scene scene = scene_create(21, 18, 3);
  reference_recipe recipe = reference_recipe_default();
  scene_fill(&scene, &recipe);
  reference_part *part = &scene.parts[0];
  for (int64_t i = 0; i < part->count; i += 3) { /* rows mirrored behind the camera */
    for (int k = 0; k < 3; k++) {
      double *mean = &part->planes[(PAGS_MEAN + k) * part->count + i];
      *mean = 2 * scene.camera.world_from_camera[4 * k + 3] - *mean;
    }
  }
  part->planes[PAGS_OPACITY * part->count + 1] = -6; /* a row of opacity below 1/255 */
  for (int k = 0; k < 3; k++)                        /* a row at the camera centre */
    part->planes[(PAGS_MEAN + k) * part->count + 4] = scene.camera.world_from_camera[4 * k + 3];
  part->planes[PAGS_SCALE * part->count + 7] = INFINITY;
  assert_int_equal(count_drawn(&scene), 18 - 6 - 3);
  check_gradient(&scene, 0.05);
  scene_destroy(&scene);
}

static void test_antialiased(void **state) {
  (void)state;
  for (int small = 0; small < 2; small++) {
    test_scene scene = scene_create(31, 14, 3);
    scene.options.antialiased = 1;
    scene.options.low_pass = small ? 0.3f : 0.1f;
    reference_recipe recipe = reference_recipe_default();
    recipe.sigma[0] = 0.3;
    recipe.sigma[1] = 2;
    recipe.logit[0] = 2;
    recipe.logit[1] = 5;
    scene_fill(&scene, &recipe);
    check_gradient(&scene, 0.05);
    scene_destroy(&scene);
  }
}

/* At its floor the compensation is constant. */
static void test_compensation_floor(void **state) {
  (void)state;
  test_scene scene = scene_create(35, 1, 3);
  scene.options.antialiased = 1;
  reference_recipe recipe = reference_recipe_default();
  recipe.sigma[0] = recipe.sigma[1] = 1e-3;
  recipe.logit[0] = recipe.logit[1] = 20;
  scene_fill(&scene, &recipe);
  reference_picture picture = scene_render(&scene);
  assert_true(picture.splats[0].floored);
  assert_true(fabs(picture.splats[0].opacity - 0.005) < 1e-9);
  reference_picture_destroy(&picture);
  check_gradient(&scene, 0.05);
  scene_destroy(&scene);
}

/* Two parts of different SH degree, with the scene's origin far away; `stretched`: their poses aren't rigid. */
static void check_two_parts(bool stretched) {
  test_scene scene = scene_create(41, 7, 3);
  scene.part_count = 2;
  scene.parts[1] = reference_part_create(8, 1);
  scene.parts[1].first_id = 7;
  scene.parts[1].alpha_min = 4.0 / 255;
  for (int p = 0; p < 2; p++)
    reference_random_pose(&scene.random, 5, scene.parts[p].world_from_model);
  const double origin[3] = {1024, -4096, 64};
  for (int k = 0; k < 3; k++) {
    scene.options.origin[k] = origin[k];
    scene.camera.world_from_camera[4 * k + 3] += origin[k];
  }
  reference_recipe recipe = reference_recipe_default();
  scene_fill(&scene, &recipe);
  if (stretched) {
    reference_stretch(&scene.parts[0], (const double[3]){0.5, 0.5, 0.5});
    reference_stretch(&scene.parts[1], (const double[3]){-1.5, 0.7, 1.2});
  }
  check_gradient(&scene, 0.05);
  scene_destroy(&scene);
}

static void test_two_parts(void **state) {
  (void)state;
  check_two_parts(false);
  check_two_parts(true);
}

/* The loss is linear in a texel, so that a difference over any step is the derivative. */
static void check_texels(test_scene *scene) {
  const int64_t floats = 18 * (int64_t)scene->sky.size * scene->sky.size;
  double *gradient = reference_alloc(floats, sizeof(double));
  reference_part_gradient parts[MAX_PARTS];
  reference_picture base = scene_render(scene);
  scene_backward(scene, &base, parts, gradient);
  int64_t seen = 0;
  for (int64_t k = 0; k < floats; k++) {
    const float texel = scene->sky.texels[k];
    scene->sky.texels[k] = texel + 1.0f; /* float rounds the sum */
    const double step = (double)scene->sky.texels[k] - (double)texel;
    reference_picture moved = scene_render(scene);
    assert_true(fabs(loss_difference(scene, &moved, &base) / step - gradient[k]) < 1e-10);
    seen += gradient[k] != 0;
    scene->sky.texels[k] = texel;
    reference_picture_destroy(&moved);
  }
  assert_true(seen >= 3);
  reference_gradient_destroy(parts, scene->part_count);
  reference_picture_destroy(&base);
  free(gradient);
}

/* The sky behind two parts, one of which has separate constant terms. The parameters' differences include the sky
 * through alpha. */
static void test_sky_and_other_sh(void **state) {
  (void)state;
  const int sizes[] = {1, 2, 7};
  for (int k = 0; k < 3; k++) {
    test_scene scene = scene_create(45 + (uint64_t)k, 6, 2);
    scene.part_count = 2;
    scene.parts[1] = reference_part_create(6, 1);
    scene.parts[1].first_id = 6;
    for (int p = 0; p < 2; p++)
      reference_random_pose(&scene.random, 5, scene.parts[p].world_from_model);
    scene.camera.fx *= 0.4, scene.camera.fy *= 0.4; /* the camera sees several faces at once */
    scene.sky = reference_random_sky(&scene.random, sizes[k]);
    reference_recipe recipe = reference_recipe_default();
    scene_fill(&scene, &recipe);
    reference_random_sh(&scene.random, &scene.parts[1]);
    check_gradient(&scene, 0.05);
    check_texels(&scene);
    scene_destroy(&scene);
  }
}

/* Case 7 of docs/lab/numerics.md: needles of 1:1e4 at 45 degrees in the picture. */
static void test_needles(void **state) {
  (void)state;
  test_scene scene = scene_create(51, 6, 1);
  reference_recipe recipe = reference_recipe_default();
  scene_fill(&scene, &recipe);
  scene.camera.world_from_camera[3] = scene.camera.world_from_camera[7] = scene.camera.world_from_camera[11] = 0;
  reference_part *part = &scene.parts[0];
  const int64_t n = part->count;
  for (int64_t i = 0; i < n; i++) {
    const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(scene.camera.world_from_camera, identity, sizeof identity);
    const double z = 2 + 0.37 * (double)i, sigma = (double)(5 + 7 * i) * z / scene.camera.fx;
    const double values[11] = {0.1 * (double)i - 0.2,
                               0.15 - 0.06 * (double)i,
                               z,
                               log(sigma),
                               log(sigma / 1e4),
                               log(sigma / 1e4),
                               2 * cos(0.39269908169872414),
                               0,
                               0,
                               (i % 2 ? 2 : -2) * sin(0.39269908169872414),
                               1.5};
    for (int plane = 0; plane < 11; plane++)
      part->planes[plane * n + i] = values[plane];
  }
  /* Along a needle the quadratic form loses most digits to cancellation, so rounding requires a longer step. */
  scene.step = 1e-3;
  reference_picture picture = scene_render(&scene);
  for (int64_t k = 0; k < n; k++) {
    const double *cov = picture.splats[k].cov;
    assert_true(fabs(fabs(cov[1]) / cov[0] - 1) < 0.1); /* the needle lies at 45 degrees */
  }
  reference_picture_destroy(&picture);
  check_gradient(&scene, 0.15);
  scene_destroy(&scene);
}

static void test_capped_alpha(void **state) {
  (void)state;
  test_scene scene = scene_create(61, 8, 1);
  reference_recipe recipe = reference_recipe_default();
  recipe.sigma[0] = 5;
  recipe.sigma[1] = 12;
  recipe.anisotropy = 2;
  recipe.logit[0] = 6;
  recipe.logit[1] = 12;
  scene_fill(&scene, &recipe);
  reference_picture picture = scene_render(&scene);
  int64_t capped = 0;
  for (int64_t k = 0; k < picture.contribution_count; k++)
    capped += picture.contributions[k].alpha_raw > REFERENCE_ALPHA_CAP;
  print_message("  %d capped\n", (int)capped);
  assert_true(capped > 10);
  reference_picture_destroy(&picture);
  check_gradient(&scene, 0.1);
  scene_destroy(&scene);
}

static void test_stacks_that_stop(void **state) {
  (void)state;
  test_scene scene = scene_create(71, 60, 0);
  reference_recipe recipe = reference_recipe_default();
  recipe.spread = 0.5;
  recipe.sigma[0] = 4;
  recipe.sigma[1] = 8;
  recipe.anisotropy = 2;
  recipe.logit[0] = 0;
  recipe.logit[1] = 2;
  scene_fill(&scene, &recipe);
  reference_picture picture = scene_render(&scene);
  int64_t nearly_opaque = 0;
  for (int k = 0; k < WIDTH * HEIGHT; k++) {
    assert_true(picture.transmittance[k] >= REFERENCE_STOP);
    nearly_opaque += picture.transmittance[k] < 1e-3;
  }
  assert_true(nearly_opaque > 100);
  reference_picture_destroy(&picture);
  check_gradient(&scene, 0.3);
  scene_destroy(&scene);
}

static void test_zero_quaternion_is_identity(void **state) {
  (void)state;
  test_scene scene = scene_create(81, 4, 3);
  reference_recipe recipe = reference_recipe_default();
  scene_fill(&scene, &recipe);
  const int64_t n = 4;
  double *planes = scene.parts[0].planes;
  for (int k = 0; k < 4; k++)
    planes[(PAGS_ROTATION + k) * n + 2] = k == 0;
  reference_picture identity = scene_render(&scene);
  planes[PAGS_ROTATION * n + 2] = 0;
  reference_picture zero = scene_render(&scene);
  assert_memory_equal(identity.rgb, zero.rgb, 3 * WIDTH * HEIGHT * sizeof(double));
  assert_true(identity.splats[2].drawn);
  reference_part_gradient gradient;
  scene_backward(&scene, &zero, &gradient, NULL);
  for (int k = 0; k < 4; k++)
    assert_true(gradient.planes[(PAGS_ROTATION + k) * n + 2] == 0);
  assert_true(gradient.planes[PAGS_SCALE * n + 2] != 0);
  reference_gradient_destroy(&gradient, 1);
  reference_picture_destroy(&identity);
  reference_picture_destroy(&zero);
  scene_destroy(&scene);
}

/* SH coefficients above options.sh_degree don't contribute to the colour and have no gradient. */
static void test_lower_sh_degree(void **state) {
  (void)state;
  for (int degree = 0; degree < 3; degree++) {
    test_scene scene = scene_create(91, 4, 3);
    scene.options.sh_degree = degree;
    reference_recipe recipe = reference_recipe_default();
    scene_fill(&scene, &recipe);
    check_gradient(&scene, 0.05);
    scene_destroy(&scene);
  }
}

/* dL/dmean2D is in pixels: moving the principal point moves every mean alike, so that the sum of dL/dmean2D is dL/dcx
 * where nothing is clamped. */
static void test_mean2d_is_in_pixels(void **state) {
  (void)state;
  test_scene scene = scene_create(101, 5, 3);
  reference_recipe recipe = reference_recipe_default();
  recipe.spread = 0.8;
  scene_fill(&scene, &recipe);
  reference_picture picture = scene_render(&scene);
  reference_part_gradient gradient;
  scene_backward(&scene, &picture, &gradient, NULL);
  for (int axis = 0; axis < 2; axis++) {
    int smooth;
    double numeric =
        finite_difference(&scene, axis ? &scene.camera.cy : &scene.camera.cx, 1e-5, picture.decisions, &smooth);
    double sum = 0;
    for (int64_t i = 0; i < 5; i++)
      sum += gradient.mean2d[2 * i + axis];
    assert_true(smooth);
    assert_true(fabs(sum - numeric) < 1e-6 * fabs(sum));
  }
  reference_gradient_destroy(&gradient, 1);
  reference_picture_destroy(&picture);
  scene_destroy(&scene);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_anisotropic_off_axis),
      cmocka_unit_test(test_clamped_jacobian),
      cmocka_unit_test(test_culled_in_front),
      cmocka_unit_test(test_antialiased),
      cmocka_unit_test(test_compensation_floor),
      cmocka_unit_test(test_two_parts),
      cmocka_unit_test(test_sky_and_other_sh),
      cmocka_unit_test(test_needles),
      cmocka_unit_test(test_capped_alpha),
      cmocka_unit_test(test_stacks_that_stop),
      cmocka_unit_test(test_zero_quaternion_is_identity),
      cmocka_unit_test(test_lower_sh_degree),
      cmocka_unit_test(test_mean2d_is_in_pixels),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
