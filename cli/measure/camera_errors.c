/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: how far the cameras of a scene, as recorded and as corrected by training, are from the true ones of a
 * synthetic set.
 *
 * The rigid motion x -> x + w x (x - c) + v about the cameras' mean c that is subtracted first minimises the sum of
 * |position error|^2 + reach^2 |angle error|^2, linearised, since errors are small:
 *   v = mean(d),   sum(|q|^2 I - q q^T + reach^2 I) w = sum(q x d + reach^2 e)
 * with q = position - c, d = true - own position, and e the rotation vector from the own to the true orientation. */
#include "cli/measure/errors.h"

#include <math.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"

/* Metres that are weighted as one radian: the typical distance of objects in a street. */
static const double reach = 10.0;
static const double degrees_per_radian = 57.29577951308232;

/* The true cameras of one camera of the rig, by frame. */
typedef struct truth {
  int64_t count; /* cameras */
  pags_camera_path *paths;
} truth;

static void destroy_truth(truth *t) {
  if (t->paths)
    for (int64_t c = 0; c < t->count; c++)
      pags_camera_path_destroy(&t->paths[c]);
  free(t->paths);
}

/* A view's camera, and what turns and moves it to the true one. */
typedef struct offset {
  double position[3];
  double d[3], e[3]; /* metres; rotation vector, radians */
  bool test;
} offset;

/* Rotation vector, in the world's axes, that turns pose `from` to pose `to`. */
static void rotation_between(const double from[12], const double to[12], double out[3]) {
  double turned[12] = {0};
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      turned[4 * i + j] = to[4 * i] * from[4 * j] + to[4 * i + 1] * from[4 * j + 1] + to[4 * i + 2] * from[4 * j + 2];
  pags_increment_rotation(turned, out);
}

/* Solves the symmetric system a x = b by Cramer's rule. */
static void solve3(const double a[9], const double b[3], double x[3]) {
  double c[3][3], determinant = 0;
  for (int i = 0; i < 3; i++)
    pags_cross3(a + (i + 1) % 3 * 3, a + (i + 2) % 3 * 3, c[i]);
  determinant = pags_dot3(a, c[0]);
  for (int k = 0; k < 3; k++)
    x[k] = determinant != 0 ? (c[0][k] * b[0] + c[1][k] * b[1] + c[2][k] * b[2]) / determinant : 0;
}

static const pags_camera *true_camera(const truth *t, const pags_scene_view *view) {
  if (view->sensor < 0 || view->sensor >= t->count || view->frame < 0 || view->frame >= t->paths[view->sensor].count)
    return NULL;
  return &t->paths[view->sensor].cameras[view->frame];
}

static pags_result measure(const pags_scene *scene, const truth *t, bool recorded, const int64_t views[2],
                           pags_camera_error out[2]) {
  double middle[3] = {0}, push[3] = {0}, a[9] = {0}, b[3] = {0}, turn[3], squares[2][2] = {{0}}, q[3], lever[3];
  int64_t count = 0;
  PAGS_AUTOFREE offset *offsets = calloc((size_t)scene->view_count + 1, sizeof *offsets);
  PAGS_CHECK_MEMORY(offsets, "%lld views", (long long)scene->view_count);
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *const view = &scene->views[i];
    const pags_camera *const wanted = true_camera(t, view);
    if (!wanted)
      continue;
    const pags_camera own = recorded ? pags_scene_view_recorded(view) : view->camera;
    offset *const o = &offsets[count++];
    o->test = view->test != 0;
    pags_pose_position(own.world_from_camera, o->position);
    pags_pose_position(wanted->world_from_camera, o->d);
    pags_subtract3(o->d, o->position, o->d);
    rotation_between(own.world_from_camera, wanted->world_from_camera, o->e);
  }

  /* The motion, from the training views. */
  for (int64_t i = 0; i < count; i++)
    if (!offsets[i].test) {
      pags_add3(middle, offsets[i].position, middle);
      pags_add3(push, offsets[i].d, push);
    }
  pags_divide3(middle, fmax((double)views[0], 1));
  pags_divide3(push, fmax((double)views[0], 1));
  for (int64_t i = 0; i < count; i++) {
    const offset *const o = &offsets[i];
    if (o->test)
      continue;
    pags_subtract3(o->position, middle, q);
    pags_cross3(q, o->d, lever);
    for (int k = 0; k < 3; k++) {
      b[k] += lever[k] + reach * reach * o->e[k];
      a[4 * k] += pags_dot3(q, q) + reach * reach;
      for (int j = 0; j < 3; j++)
        a[3 * k + j] -= q[k] * q[j];
    }
  }
  solve3(a, b, turn);

  /* The remaining errors. */
  for (int64_t i = 0; i < count; i++) {
    const offset *const o = &offsets[i];
    pags_subtract3(o->position, middle, q);
    pags_cross3(turn, q, lever);
    for (int k = 0; k < 3; k++) {
      squares[o->test][0] += pow(o->d[k] - push[k] - lever[k], 2);
      squares[o->test][1] += pow(o->e[k] - turn[k], 2);
    }
  }
  for (int test = 0; test < 2; test++)
    out[test] = (pags_camera_error){sqrt(squares[test][0] / fmax((double)views[test], 1)),
                                    sqrt(squares[test][1] / fmax((double)views[test], 1)) * degrees_per_radian};
  return PAGS_OK;
}

pags_result pags_camera_errors_measure(const char *dataset, const pags_scene *scene, pags_camera_errors *out) {
  PAGS_AUTO(destroy_truth) truth t = {0};
  *out = (pags_camera_errors){0};
  for (int64_t i = 0; i < scene->view_count; i++)
    t.count = scene->views[i].sensor >= t.count ? scene->views[i].sensor + 1 : t.count;
  t.paths = calloc((size_t)t.count + 1, sizeof *t.paths);
  PAGS_CHECK_MEMORY(t.paths, "the true cameras of %s", dataset);
  for (int64_t c = 0; c < t.count; c++) {
    PAGS_AUTOFREE char *path = pags_text_format("%s/truth/cameras/%lld.json", dataset, (long long)c);
    PAGS_CHECK_MEMORY(path, "the true cameras of %s", dataset);
    if (pags_file_exists(path))
      PAGS_TRY(pags_camera_path_load(path, &t.paths[c]));
  }
  for (int64_t i = 0; i < scene->view_count; i++)
    out->views[scene->views[i].test != 0] += true_camera(&t, &scene->views[i]) != NULL;
  PAGS_TRY(measure(scene, &t, true, out->views, out->recorded));
  return measure(scene, &t, false, out->views, out->corrected);
}

static void put_error(pags_json_writer *writer, const char *key, const pags_camera_error *error) {
  pags_json_begin_object(writer, key);
  pags_json_put_number(writer, "metres", error->metres);
  pags_json_put_number(writer, "degrees", error->degrees);
  pags_json_end_object(writer);
}

void pags_camera_errors_put_json(pags_json_writer *writer, const pags_camera_errors *e) {
  static const char *const sets[2] = {"train", "test"};
  if (e->views[0] == 0) {
    pags_json_put_null(writer, "cameras");
    return;
  }
  pags_json_begin_object(writer, "cameras");
  for (int test = 0; test < 2; test++) {
    if (e->views[test] == 0)
      continue;
    pags_json_begin_object(writer, sets[test]);
    pags_json_put_integer(writer, "views", e->views[test]);
    put_error(writer, "recorded", &e->recorded[test]);
    put_error(writer, "corrected", &e->corrected[test]);
    pags_json_end_object(writer);
  }
  pags_json_end_object(writer);
}
