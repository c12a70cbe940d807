/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: how far the cameras of a scene, as recorded and as corrected by training, are from the true ones of a
 * synthetic set.
 *
 * The rigid motion x -> x + w x (x - c) + v about the cameras' mean c that is subtracted first minimises the sum of
 * |position error|^2 + reach^2 |angle error|^2, linearised, since errors are small:
 *   v = mean(d),   sum(|q|^2 I - q q^T + reach^2 I) w = sum(q x d + reach^2 e)
 * with q = position - c, d = true - own position, and e the rotation vector from the own to the true orientation. */
#include "cli/measure/camera_errors.h"

#include <math.h>
#include <stdlib.h>

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

static pags_camera camera_of(const pags_scene_view *view, bool recorded) {
  return recorded ? pags_scene_view_recorded(view) : view->camera;
}

static void measure(const pags_scene *scene, const truth *t, bool recorded, pags_camera_error out[2]) {
  double middle[3] = {0}, push[3] = {0}, a[9] = {0}, b[3] = {0}, turn[3], squares[2][2] = {{0}};
  int64_t count[2] = {0};
  for (int pass = 0; pass < 3; pass++) {
    for (int64_t i = 0; i < scene->view_count; i++) {
      const pags_scene_view *view = &scene->views[i];
      const pags_camera *wanted = true_camera(t, view);
      if (!wanted || (view->test && pass < 2))
        continue;
      const pags_camera own = camera_of(view, recorded);
      double d[3], q[3], e[3], lever[3];
      for (int k = 0; k < 3; k++) {
        d[k] = wanted->world_from_camera[4 * k + 3] - own.world_from_camera[4 * k + 3];
        q[k] = own.world_from_camera[4 * k + 3] - middle[k];
      }
      rotation_between(own.world_from_camera, wanted->world_from_camera, e);
      if (pass == 0) { /* sums of positions and of their errors */
        count[0]++;
        for (int k = 0; k < 3; k++) {
          b[k] += own.world_from_camera[4 * k + 3];
          push[k] += d[k];
        }
      } else if (pass == 1) { /* the rotation's system */
        pags_cross3(q, d, lever);
        for (int k = 0; k < 3; k++) {
          b[k] += lever[k] + reach * reach * e[k];
          a[4 * k] += pags_dot3(q, q) + reach * reach;
          for (int j = 0; j < 3; j++)
            a[3 * k + j] -= q[k] * q[j];
        }
      } else { /* remaining errors */
        pags_cross3(turn, q, lever);
        for (int k = 0; k < 3; k++) {
          squares[view->test != 0][0] += pow(d[k] - push[k] - lever[k], 2);
          squares[view->test != 0][1] += pow(e[k] - turn[k], 2);
        }
        count[view->test != 0]++;
      }
    }
    for (int k = 0; k < 3 && pass == 0; k++) {
      middle[k] = b[k] / (double)(count[0] > 0 ? count[0] : 1);
      push[k] /= (double)(count[0] > 0 ? count[0] : 1);
      b[k] = 0;
    }
    if (pass == 0)
      count[0] = 0;
    if (pass == 1)
      solve3(a, b, turn);
  }
  for (int test = 0; test < 2; test++) {
    const double views = (double)(count[test] > 0 ? count[test] : 1);
    out[test] =
        (pags_camera_error){sqrt(squares[test][0] / views), sqrt(squares[test][1] / views) * degrees_per_radian};
  }
}

/* Reads the files of all cameras of the scene that have one. */
static pags_result read_truth(const char *dataset, const pags_scene *scene, truth *t) {
  for (int64_t i = 0; i < scene->view_count; i++)
    t->count = scene->views[i].sensor >= t->count ? scene->views[i].sensor + 1 : t->count;
  t->paths = calloc((size_t)t->count + 1, sizeof *t->paths);
  if (!t->paths)
    return pags_out_of_memory("the true cameras of %s", dataset);
  for (int64_t c = 0; c < t->count; c++) {
    char *path = pags_text_format("%s/truth/cameras/%lld.json", dataset, (long long)c);
    if (!path)
      return pags_out_of_memory("the true cameras of %s", dataset);
    const pags_result result = pags_file_exists(path) ? pags_camera_path_load(path, &t->paths[c]) : PAGS_OK;
    free(path);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

pags_result pags_camera_errors_measure(const char *dataset, const pags_scene *scene, pags_camera_errors *out) {
  truth t = {0};
  *out = (pags_camera_errors){0};
  const pags_result result = read_truth(dataset, scene, &t);
  if (result == PAGS_OK) {
    for (int64_t i = 0; i < scene->view_count; i++)
      out->views[scene->views[i].test != 0] += true_camera(&t, &scene->views[i]) != NULL;
    measure(scene, &t, true, out->recorded);
    measure(scene, &t, false, out->corrected);
  }
  for (int64_t c = 0; t.paths && c < t.count; c++)
    pags_camera_path_destroy(&t.paths[c]);
  free(t.paths);
  return result;
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
