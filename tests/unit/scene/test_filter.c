/* SPDX-License-Identifier: Apache-2.0 */
/* Tests which Gaussians pags_scene_filter leaves out by each of its limits. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "scene/filter.h"

/* Four Gaussians on the x axis at 0, 1, 2 and 3 m, with rising opacities and falling sizes. */
static void make(pags_scene *scene, pags_model *model) {
  *scene = (pags_scene){.model_count = 1, .models = model, .origin = {100, 200, 300}};
  *model = (pags_model){0};
  assert_int_equal(pags_gaussians_create(&model->gaussians, 4, 0), PAGS_OK);
  for (int i = 0; i < 4; i++) {
    const double opacity = 0.2 + 0.2 * i;
    pags_plane(&model->gaussians, PAGS_MEAN)[i] = (float)i;
    pags_plane(&model->gaussians, PAGS_ROTATION)[i] = 1;
    pags_plane(&model->gaussians, PAGS_OPACITY)[i] = (float)log(opacity / (1 - opacity));
    for (int k = 0; k < 3; k++)
      pags_plane(&model->gaussians, PAGS_SCALE + k)[i] = (float)log(k == 1 ? 1.0 / (i + 1) : 0.01);
  }
}

/* Filters; returns the remaining Gaussians as bits: 1 for x = 0, 2 for x = 1, ...; -1 after an error. */
static int left(const pags_filter *filter, const pags_scene_view *views, int64_t view_count) {
  pags_scene scene;
  pags_model model;
  int64_t count;
  int bits = 0;
  pags_scene_view own[2];
  make(&scene, &model);
  for (int64_t i = 0; i < view_count; i++)
    own[i] = views[i];
  scene.views = own;
  scene.view_count = view_count;
  const pags_result result = pags_scene_filter(&scene, filter, 0, NULL, &count);
  for (int64_t i = 0; i < model.gaussians.count; i++)
    bits |= 1 << (int)pags_plane(&model.gaussians, PAGS_MEAN)[i];
  assert_true(result != PAGS_OK || count == model.gaussians.count);
  pags_gaussians_destroy(&model.gaussians);
  return result == PAGS_OK ? bits : -1;
}

static void gaussians_beyond_limits_are_left_out(void **state) {
  (void)state;
  const pags_filter none = {0}, box = {.has_box = true, .lo = {0.5, -1, -1}, .hi = {2.5, 1, 1}},
                    ball = {.has_ball = true, .middle = {3, 0, 0}, .radius = 1.5}, opaque = {.least_opacity = 0.5},
                    large = {.least_size = 0.4}, small = {.greatest_size = 0.4},
                    both = {.has_box = true, .lo = {0.5, -1, -1}, .hi = {2.5, 1, 1}, .least_opacity = 0.5},
                    nowhere = {.has_ball = true, .middle = {30, 0, 0}, .radius = 1.5};
  assert_false(pags_filter_is_set(&none));
  assert_true(pags_filter_is_set(&small));
  assert_int_equal(left(&none, NULL, 0), 15);
  assert_int_equal(left(&box, NULL, 0), 6);
  assert_int_equal(left(&ball, NULL, 0), 12);
  assert_int_equal(left(&opaque, NULL, 0), 12);
  assert_int_equal(left(&large, NULL, 0), 3);
  assert_int_equal(left(&small, NULL, 0), 12);
  assert_int_equal(left(&both, NULL, 0), 4);
  assert_int_equal(left(&nowhere, NULL, 0), -1);
}

/* Two cameras 2 m away look along y: one sees x = 0 and 1, the other x = 1, 2 and 3. A held-out camera sees all. */
static void gaussians_need_enough_views(void **state) {
  (void)state;
  pags_scene_view views[2] = {{.name = NULL}};
  for (int i = 0; i < 2; i++) {
    const double pose[12] = {1, 0, 0, (i ? 2 : 0.5) + 100, 0, 0, 1, 198, 0, -1, 0, 300};
    views[i].camera = (pags_camera){.width = 100, .height = 100, .fx = 100, .fy = 100, .cx = 50, .cy = 50};
    if (i)
      views[i].camera.fx = views[i].camera.fy = 80;
    memcpy(views[i].camera.world_from_camera, pose, sizeof pose);
  }
  const pags_filter one = {.least_views = 1}, two = {.least_views = 2};
  assert_int_equal(left(&one, views, 1), 3);
  assert_int_equal(left(&one, views, 2), 15);
  assert_int_equal(left(&two, views, 2), 2);
  views[0].test = 1;
  assert_int_equal(left(&one, views, 2), 14);
  views[1].test = 1;
  assert_int_equal(left(&one, views, 2), -1);
  assert_int_equal(left(&one, views, 0), -1);
}

/* An object with its own model is kept or left out as a whole, by its position at the time. */
static void objects_are_judged_whole(void **state) {
  (void)state;
  pags_scene scene = {0};
  pags_model models[2] = {{0}};
  pags_keyframe keyframes[2] = {{.time = 0, .world_from_object = {1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0}},
                                {.frame = 1, .time = 1, .world_from_object = {1, 0, 0, 9, 0, 1, 0, 0, 0, 0, 1, 0}}};
  for (int time = 0; time < 2; time++) {
    pags_scene_object object = {.record = {.size = {1, 1, 1}, .moving = 1, .keyframe_count = 2, .keyframes = keyframes},
                                .model = 1};
    uint8_t chosen = 1;
    int64_t count;
    const pags_filter ball = {.has_ball = true, .middle = {9, 0, 0}, .radius = 1};
    scene = (pags_scene){.model_count = 2, .models = models, .object_count = 1, .objects = &object};
    assert_int_equal(pags_gaussians_create(&models[0].gaussians, 1, 0), PAGS_OK);
    assert_int_equal(pags_gaussians_create(&models[1].gaussians, 3, 0), PAGS_OK);
    pags_plane(&models[0].gaussians, PAGS_MEAN)[0] = 9;
    pags_plane(&models[0].gaussians, PAGS_ROTATION)[0] = 1;
    assert_int_equal(pags_scene_filter(&scene, &ball, time, &chosen, &count), PAGS_OK);
    assert_int_equal(count, time ? 4 : 1);
    assert_int_equal(chosen, time);
    for (int m = 0; m < 2; m++)
      pags_gaussians_destroy(&models[m].gaussians);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(gaussians_beyond_limits_are_left_out),
      cmocka_unit_test(gaussians_need_enough_views),
      cmocka_unit_test(objects_are_judged_whole),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
