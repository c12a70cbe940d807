/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the places for cameras in scenes without photographs, and the orbits made of them: objects are seen whole
 * from outside, rooms from within; no camera is in a wall. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include <pags/scene.h>

#include "cli/draw/camera_paths.h"
#include "scene/survey.h"

const char pags_program_name[] = "test";

/* Adds flat Gaussians on the faces of a box to `g`, `across` x `across` on each face. */
static void put_box(pags_gaussians *g, const double lo[3], const double hi[3], int across) {
  for (int face = 0; face < 6; face++)
    for (int i = 0; i < across * across; i++) {
      const int axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
      const int64_t row = g->count++;
      double p[3];
      p[axis] = face % 2 ? hi[axis] : lo[axis];
      p[u] = lo[u] + (hi[u] - lo[u]) * (i % across + 0.5) / across;
      p[v] = lo[v] + (hi[v] - lo[v]) * (double)(i / across * 2 + 1) / (2 * across);
      for (int k = 0; k < 3; k++) {
        pags_plane(g, PAGS_MEAN + k)[row] = (float)p[k];
        pags_plane(g, PAGS_SCALE + k)[row] = (float)log(k == axis ? 0.005 : 0.7 * (hi[k] - lo[k]) / across);
      }
      pags_plane(g, PAGS_ROTATION)[row] = 1;
      pags_plane(g, PAGS_OPACITY)[row] = 4;
    }
}

static void make(pags_scene *scene, pags_model *model) {
  *scene = (pags_scene){.up = PAGS_UP_MINUS_Y, .model_count = 1, .models = model};
  *model = (pags_model){0};
  assert_int_equal(pags_gaussians_create(&model->gaussians, 60000, 0), PAGS_OK);
  model->gaussians.count = 0;
}

static void room_is_seen_from_within(void **state) {
  (void)state;
  pags_scene scene;
  pags_model model;
  pags_survey survey;
  pags_camera_path path;
  const double lo[3] = {-3, -2.6, -2.5}, hi[3] = {3, 0, 2.5}, table_lo[3] = {-0.8, -0.75, -0.5},
               table_hi[3] = {0.8, -0.1, 0.5};
  make(&scene, &model);
  put_box(&model.gaussians, lo, hi, 40);
  put_box(&model.gaussians, table_lo, table_hi, 12);
  assert_int_equal(pags_survey_make(&scene, &survey), PAGS_OK);
  assert_true(survey.inside);
  double places[20][3];
  const int count = pags_survey_places(&survey, 20, places);
  assert_int_equal(count, 20);
  for (int i = 0; i < count; i++)
    for (int k = 0; k < 3; k++)
      assert_true(places[i][k] > lo[k] && places[i][k] < hi[k]);
  pags_survey_destroy(&survey);
  assert_int_equal(pags_camera_path_orbit(&scene, 90, PAGS_STAND_AUTO, &path), PAGS_OK);
  for (int64_t i = 0; i < path.count; i++) {
    bool in_table = true;
    for (int k = 0; k < 3; k++) {
      const double eye = path.cameras[i].world_from_camera[4 * k + 3];
      assert_true(eye > lo[k] + 0.1 && eye < hi[k] - 0.1);
      in_table = in_table && eye > table_lo[k] && eye < table_hi[k];
    }
    assert_false(in_table);
  }
  pags_camera_path_destroy(&path);
  pags_gaussians_destroy(&model.gaussians);
}

/* All corners of a tall box are in the picture of every camera, and no camera is in the box. */
static void object_is_seen_whole(void **state) {
  (void)state;
  pags_scene scene;
  pags_model model;
  pags_camera_path path;
  const double lo[3] = {-0.3, -2, -0.4}, hi[3] = {0.3, 0, 0.4}, middle[3] = {0, -1, 0};
  make(&scene, &model);
  for (int i = 0; i < 12; i++) { /* the box is filled with Gaussians, as objects are after training */
    double from[3], to[3];
    for (int k = 0; k < 3; k++) {
      from[k] = middle[k] + (lo[k] - middle[k]) * (12 - i) / 12;
      to[k] = middle[k] + (hi[k] - middle[k]) * (12 - i) / 12;
    }
    put_box(&model.gaussians, from, to, 20);
  }
  for (int k = 0; k < 3; k++) /* one stray Gaussian far away */
    pags_plane(&model.gaussians, PAGS_MEAN + k)[0] = 500;
  assert_int_equal(pags_camera_path_orbit(&scene, 24, PAGS_STAND_AUTO, &path), PAGS_OK);
  for (int64_t i = 0; i < path.count; i++) {
    const pags_camera *camera = &path.cameras[i];
    double from_world[12], largest = 0;
    pags_rigid_inverse(camera->world_from_camera, from_world);
    for (int c = 0; c < 8; c++) {
      double corner[3], p[3];
      for (int k = 0; k < 3; k++)
        corner[k] = c >> k & 1 ? hi[k] : lo[k];
      pags_rigid_point(from_world, corner, p);
      assert_true(p[2] > 0);
      largest = fmax(largest, fabs(p[0] / p[2] * camera->fx) / camera->cx);
      largest = fmax(largest, fabs(p[1] / p[2] * camera->fy) / camera->cy);
    }
    assert_true(largest < 1);
    assert_true(largest > 0.7);
  }
  pags_camera_path_destroy(&path);
  pags_gaussians_destroy(&model.gaussians);
}

/* Cameras stand on a ring round an object, 2 m away and on one side 4 m. On the other side a new wall stands in the
 * way, and the orbit passes in front of it. */
static void orbit_follows_the_photographs(void **state) {
  (void)state;
  enum { VIEWS = 36 };
  pags_scene scene;
  pags_model model;
  pags_scene_view views[VIEWS];
  pags_camera_path path;
  const double lo[3] = {-0.3, -0.3, -0.3}, hi[3] = {0.3, 0.3, 0.3};
  make(&scene, &model);
  put_box(&model.gaussians, lo, hi, 30);
  for (int i = 0; i < 4; i++) { /* the object is filled with Gaussians */
    const double wall_lo[3] = {-2.2 + 0.06 * i, -1.5, -1.2}, wall_hi[3] = {-1.7 - 0.06 * i, 1.5, 1.2};
    put_box(&model.gaussians, wall_lo, wall_hi, 40);
  }
  memset(views, 0, sizeof views);
  for (int i = 0; i < VIEWS; i++) {
    const double a = 2 * 3.14159265358979 * i / VIEWS, c = cos(a), s = sin(a), r = c > 0.5 ? 4 : 2;
    const double pose[12] = {-s, 0, -c, r * c, 0, 1, 0, 0, c, 0, -s, r * s};
    if (c < -0.78)
      continue;
    pags_scene_view *view = &views[scene.view_count++];
    view->camera =
        (pags_camera){.width = 320, .height = 240, .fx = 300, .fy = 300, .cx = 160, .cy = 120, .time = (double)NAN};
    memcpy(view->camera.world_from_camera, pose, sizeof pose);
    view->sensor = -1;
  }
  scene.views = views;
  assert_int_equal(pags_camera_path_orbit(&scene, 72, PAGS_STAND_AUTO, &path), PAGS_OK);
  double least = 9;
  for (int64_t i = 0; i < path.count; i++) {
    const double *m = path.cameras[i].world_from_camera, r = hypot(m[3], m[11]);
    assert_true(fabs(m[7]) < 0.05);
    assert_true(r > 0.5 && r < 4.1);
    assert_true(m[3] < 0.95 * r || r > 3.4);
    assert_false(m[3] > -2.2 && m[3] < -1.7 && fabs(m[11]) < 1.1);
    least = fmin(least, m[3]);
  }
  assert_true(least < -1); /* the orbit is a full turn */
  pags_camera_path_destroy(&path);
  pags_gaussians_destroy(&model.gaussians);
}

static void an_empty_scene_has_no_orbit(void **state) {
  (void)state;
  pags_scene scene = {0};
  pags_camera_path path;
  pags_survey survey;
  assert_int_equal(pags_camera_path_orbit(&scene, 4, PAGS_STAND_AUTO, &path), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_survey_make(&scene, &survey), PAGS_OK);
  assert_false(survey.inside);
  pags_survey_destroy(&survey);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(room_is_seen_from_within),
      cmocka_unit_test(object_is_seen_whole),
      cmocka_unit_test(orbit_follows_the_photographs),
      cmocka_unit_test(an_empty_scene_has_no_orbit),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
