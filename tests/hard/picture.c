/* SPDX-License-Identifier: Apache-2.0 */
/* Compares pictures and gradients of the hard cases with the oracle; see hard.h. */
#include "hard/hard.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

hard_scene hard_scene_create(uint64_t seed, int64_t count) {
  hard_scene s = {.random = {seed}, .options = reference_options()};
  s.camera = (pags_camera){.width = HARD_WIDTH,
                           .height = HARD_HEIGHT,
                           .fx = HARD_FOCAL,
                           .fy = HARD_FOCAL,
                           .cx = 47.3,
                           .cy = 33.1,
                           .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  s.options.extra_channels = 1;
  s.options.background[0] = 0.25f, s.options.background[1] = 0.5f, s.options.background[2] = 0.75f;
  s.part = reference_part_create(count, 3);
  s.hidden = reference_alloc(count, 1);
  const reference_recipe recipe = reference_recipe_default();
  for (int64_t i = 0; i < count; i++)
    reference_random_gaussian(&s.random, &recipe, &s.camera, &s.options, &s.part, i);
  return s;
}

void hard_scene_destroy(hard_scene *scene) {
  reference_part_destroy(&scene->part);
  free(scene->hidden);
}

double *hard_at(hard_scene *scene, int plane, int64_t row) {
  return &scene->part.planes[plane * scene->part.count + row];
}

void hard_put(hard_scene *scene, int64_t row, double x, double y, double z, double sigma, double logit) {
  const double values[11] = {x, y, z, log(sigma), log(sigma), log(sigma), 1, 0, 0, 0, logit};
  for (int plane = 0; plane < 11; plane++)
    *hard_at(scene, plane, row) = values[plane];
}

frame_result hard_run(hard_scene *scene, const double *weights) {
  pags_tasks *tasks = pags_tasks_create(2);
  pags_frame *frame = NULL;
  const int64_t pixels = (int64_t)scene->camera.width * scene->camera.height;
  assert_non_null(tasks);
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  frame_scene here = frame_scene_create(&scene->part, 1, 16, 0);
  const reference_picture_gradient gradient = {weights, weights ? weights + 3 * pixels : NULL,
                                               weights ? weights + 4 * pixels : NULL, NULL};
  frame_result result = frame_run(frame, &here, &scene->camera, &scene->options, weights ? &gradient : NULL);
  assert_true(frame_result_finite(&result));
  scene->stats = *pags_frame_stats_get(frame);
  frame_scene_destroy(&here);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  return result;
}

static int is_in_band(const reference_picture *picture, int64_t pixel) {
  return picture->margin[pixel] < 1e-4 || picture->depth_margin[pixel] < 1e-6;
}

/* Makes random loss weights, small enough for depth not to dominate the colours, and zero where rounding may change
 * a decision. Returns the share of such pixels in `left_out`. */
static double *make_weights(hard_scene *scene, const reference_picture *picture, double *left_out) {
  const int64_t pixels = (int64_t)picture->width * picture->height;
  double *weights = reference_alloc(5 * pixels, sizeof(double));
  int64_t in_band = 0;
  for (int64_t k = 0; k < pixels; k++) {
    in_band += is_in_band(picture, k);
    for (int plane = 0; plane < 5; plane++) {
      const double value = (double)(float)reference_uniform(&scene->random, -1, 1) * (plane == 4 ? 0.25 : 1);
      weights[plane * pixels + k] = is_in_band(picture, k) ? 0 : value;
    }
  }
  *left_out = (double)in_band / (double)pixels;
  return weights;
}

static double colour_error(const reference_picture *exact, const frame_result *drawn) {
  const int64_t pixels = (int64_t)exact->width * exact->height;
  double worst = 0;
  for (int64_t k = 0; k < pixels; k++) {
    if (is_in_band(exact, k))
      continue;
    worst = fmax(worst, fabs((double)drawn->transmittance[k] - exact->transmittance[k]));
    for (int channel = 0; channel < 3; channel++)
      worst = fmax(worst, fabs((double)drawn->rgb[channel * pixels + k] - exact->rgb[channel * pixels + k]));
  }
  return worst;
}

/* Groups of parameter planes with the same unit. */
static const struct group {
  int first, last;
} groups[] = {{PAGS_MEAN, PAGS_SCALE}, {PAGS_SCALE, PAGS_ROTATION}, {PAGS_ROTATION, PAGS_OPACITY},
              {PAGS_OPACITY, PAGS_SH}, {PAGS_SH, PAGS_SH + 3},      {PAGS_SH + 3, PAGS_MAX_PLANES}};

static double row_length(const struct group *group, const double *exact, const float *drawn, int64_t count,
                         int64_t row) {
  double square = 0;
  for (int p = group->first; p < group->last; p++) {
    const double value = exact[p * count + row] - (drawn ? (double)drawn[p * count + row] : 0);
    square += value * value;
  }
  return sqrt(square);
}

static double group_size(const struct group *group, const reference_part_gradient *exact,
                         const reference_splat *splats) {
  double square = 0;
  int64_t rows = 0;
  for (int64_t i = 0; i < exact->count; i++) {
    const double length = splats[i].drawn ? row_length(group, exact->planes, NULL, exact->count, i) : 0;
    square += length * length;
    rows += length > 0;
  }
  return sqrt(square / (double)(rows > 0 ? rows : 1));
}

/* Returns the largest relative error of a group of parameters. Rotating a ball changes nothing, so that its rotation
 * gradient is only rounding noise, which is compared with the gradient of the scales. */
static double group_error(size_t g, const reference_part_gradient *exact, const frame_part_result *drawn,
                          const reference_splat *splats) {
  const struct group *group = &groups[g];
  double size = group_size(group, exact, splats), worst = 0;
  if (group->first == PAGS_ROTATION)
    size = fmax(size, group_size(&groups[g - 1], exact, splats));
  const double floor = 1e-2 * size;
  for (int64_t i = 0; i < exact->count; i++) {
    const double length = row_length(group, exact->planes, NULL, exact->count, i);
    const double difference = row_length(group, exact->planes, drawn->planes, exact->count, i);
    if (difference > 0)
      worst = fmax(worst, difference / fmax(length, floor));
  }
  return worst;
}

/* A copy of the part for the oracle, without the rows that are marked as hidden. */
static reference_part exact_part(const hard_scene *scene) {
  reference_part part = reference_part_create(scene->part.count, scene->part.sh_degree);
  memcpy(part.planes, scene->part.planes, (size_t)(part.count * pags_plane_count(part.sh_degree)) * sizeof(double));
  for (int64_t i = 0; i < part.count; i++)
    if (scene->hidden[i])
      part.planes[PAGS_OPACITY * part.count + i] = -1000;
  return part;
}

hard_error hard_compare(hard_scene *scene) {
  frame_scene_round(&scene->part);
  reference_part part = exact_part(scene);
  reference_picture picture = reference_render(&part, 1, &scene->camera, &scene->options);
  hard_error error = {0};
  double *weights = make_weights(scene, &picture, &error.left_out);
  const int64_t pixels = (int64_t)picture.width * picture.height;
  const reference_picture_gradient gradient = {weights, weights + 3 * pixels, weights + 4 * pixels, NULL};
  reference_part_gradient exact;
  reference_backward(&part, 1, &scene->camera, &scene->options, &picture, &gradient, &exact);
  frame_result drawn = hard_run(scene, weights);
  assert_int_equal(drawn.bad_rows, 0);
  error.colour = colour_error(&picture, &drawn);
  for (size_t g = 0; g < sizeof groups / sizeof *groups; g++)
    error.gradient = fmax(error.gradient, group_error(g, &exact, &drawn.parts[0], picture.splats));
  for (int64_t i = 0; i < scene->part.count; i++) {
    error.drawn += picture.splats[i].drawn;
    error.disagreed += drawn.parts[0].drawn[i] && !picture.splats[i].drawn;
  }
  for (int64_t k = 0; k < picture.contribution_count; k++)
    error.disagreed += !drawn.parts[0].drawn[picture.contributions[k].gaussian] &&
                       !is_in_band(&picture, picture.contributions[k].pixel);
  frame_result_destroy(&drawn);
  reference_gradient_destroy(&exact, 1);
  reference_picture_destroy(&picture);
  reference_part_destroy(&part);
  free(weights);
  return error;
}

hard_error hard_expect(const char *what, hard_scene *scene, double colour, double gradient) {
  const hard_error e = hard_compare(scene);
  print_message("  %-40s colour %.1e, gradient %.1e; %d rows drawn, %.1f %% of pixels left out\n", what, e.colour,
                e.gradient, (int)e.drawn, 100 * e.left_out);
  assert_int_equal(e.disagreed, 0);
  assert_true(e.colour <= colour);
  assert_true(e.gradient <= gradient);
  return e;
}
