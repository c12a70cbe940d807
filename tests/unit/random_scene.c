/* SPDX-License-Identifier: Apache-2.0 */
/* The random scene that the tests of whole frames share; see random_scene.h. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>
#include <math.h>

fixture fixture_create(uint64_t seed, int64_t count) {
  fixture f = {.random = {seed}, .options = reference_options()};
  f.options.extra_channels = 1;
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

void fixture_destroy(fixture *f) {
  reference_part_destroy(&f->part);
  free(f->weights);
}

double *fixture_at(fixture *f, int plane, int64_t i) {
  return &f->part.planes[plane * f->part.count + i];
}

engine engine_create(int threads) {
  engine e = {.tasks = pags_tasks_create(threads)};
  assert_non_null(e.tasks);
  assert_int_equal(pags_frame_create(e.tasks, &e.frame), PAGS_OK);
  return e;
}

void engine_destroy(engine *e) {
  pags_frame_destroy(e->frame);
  pags_tasks_destroy(e->tasks);
}

frame_result fixture_run(engine *e, const fixture *f, int cluster_size, uint64_t shuffle_seed) {
  frame_scene scene = frame_scene_create(&f->part, 1, cluster_size, shuffle_seed);
  scene.sky_cut = f->sky_cut;
  const reference_picture_gradient gradient = {f->weights, f->weights + 3 * PIXELS, f->weights + 4 * PIXELS, NULL};
  frame_result result = frame_run(e->frame, &scene, &f->camera, &f->options, &gradient);
  frame_scene_destroy(&scene);
  return result;
}

frame_result fixture_run_finite(const fixture *f) {
  engine e = engine_create(2);
  frame_result result = fixture_run(&e, f, 16, 0);
  assert_true(frame_result_finite(&result));
  engine_destroy(&e);
  return result;
}

int fixture_is_background(const fixture *f, const frame_result *result) {
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
