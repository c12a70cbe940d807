/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the views of a scene as glTF cameras, and the tracks of objects and of the ego vehicle as animated nodes. A
 * view's facts that glTF's perspective camera has no place for (principal point, held out or not) go to the node's
 * extras. */
#include "exporters/format/gltf.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/sort.h"
#include "exporters/format/object_gaussians.h"
#include "scene/scene_json.h"

pags_result pags_gltf_node_place(pags_gltf *gltf, int node, const pags_scene *scene, const pags_object *object,
                                 double time_zero) {
  PAGS_AUTO(pags_object_track_destroy) pags_object_track track = {0};
  PAGS_TRY(pags_object_track_make(scene, object, time_zero, &track));
  pags_gltf_node_pose(gltf, node, track.poses[0]);
  if (track.count > 1)
    pags_gltf_node_track(gltf, node, track.count, track.times, (const double(*)[12])track.poses);
  return PAGS_OK;
}

/* ---- Views ---- */

/* A glTF camera that is already in the file. Views of the same intrinsics share it. */
typedef struct kind {
  int index;
  pags_camera camera;
} kind;

/* The index of the glTF camera with the view's intrinsics; added if missing. */
static int camera_of(pags_gltf *gltf, kind *kinds, int64_t *count, const pags_camera *camera) {
  char name[32];
  for (int64_t i = 0; i < *count; i++) {
    const pags_camera *other = &kinds[i].camera;
    if (other->width == camera->width && other->height == camera->height && other->fx == camera->fx &&
        other->fy == camera->fy)
      return kinds[i].index;
  }
  snprintf(name, sizeof name, "camera_%lld", (long long)*count);
  kinds[*count] = (kind){pags_gltf_camera(gltf, name, camera), *camera};
  return kinds[(*count)++].index;
}

/* Converts a camera's pose to other axes, relative to the scene's origin: column c of the rotation becomes sign[c]
 * times column order[c] of the rotation of `from`. */
static void turn(const pags_scene *scene, const double from[12], const int order[3], const double sign[3],
                 double out[12]) {
  for (int k = 0; k < 3; k++) {
    for (int c = 0; c < 3; c++)
      out[4 * k + c] = sign[c] * from[4 * k + order[c]];
    out[4 * k + 3] = from[4 * k + 3] - scene->origin[k];
  }
}

/* Adds the node of one view. glTF's cameras look along -z with y up, ours along z with y down. */
static pags_result add_view(pags_gltf *gltf, int parent, const pags_scene *scene, const pags_scene_view *view,
                            int camera, double time_zero) {
  static const int order[3] = {0, 1, 2};
  static const double sign[3] = {1, -1, -1};
  double pose[12];
  char name[96];
  const char *file = pags_path_name(view->name);
  int stem = (int)(strlen(file) - strlen(pags_path_extension(file)));
  snprintf(name, sizeof name, "%.*s", stem < 90 ? stem : 90, file);
  int node = pags_gltf_node(gltf, parent, name);
  turn(scene, view->camera.world_from_camera, order, sign, pose);
  pags_gltf_node_pose(gltf, node, pose);
  pags_gltf_node_camera(gltf, node, camera);

  /* The extras: name, whether held out, time, sensor, and the full intrinsics in pixels. */
  const pags_camera *c = &view->camera;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  pags_json_put_string(&w, "view", view->name);
  pags_json_put_bool(&w, "test", view->test);
  pags_json_put_number(&w, "time", c->time - time_zero);
  if (view->sensor >= 0)
    pags_json_put_integer(&w, "sensor", view->sensor);
  pags_camera_lens_to_json(&w, c);
  if (pags_camera_bends(c))
    pags_lens_to_json(&w, "lens", &c->lens);
  return pags_gltf_put_extras(gltf, node, &w);
}

static int compare_times(const void *left, const void *right) {
  const pags_scene_view *a = *(const pags_scene_view *const *)left, *b = *(const pags_scene_view *const *)right;
  if (a->camera.time != b->camera.time)
    return a->camera.time < b->camera.time ? -1 : 1;
  return strcmp(a->name, b->name);
}

/* Adds the node `ego`, animated with the poses of all views of the sensor of the least number, sorted by time. */
static pags_result add_ego(pags_gltf *gltf, int parent, const pags_scene *scene, double time_zero) {
  static const int order[3] = {2, 0, 1};
  static const double sign[3] = {1, -1, -1};
  const size_t most = (size_t)scene->view_count;
  int sensor = scene->views[0].sensor;
  int64_t count = 0;
  PAGS_AUTOFREE const pags_scene_view **list = malloc(most * sizeof *list);
  PAGS_AUTOFREE double *times = malloc(most * sizeof *times);
  PAGS_AUTOFREE double(*poses)[12] = malloc(most * sizeof *poses);
  PAGS_CHECK_MEMORY(list && times && poses, "%lld views", (long long)scene->view_count);
  for (int64_t i = 1; i < scene->view_count; i++)
    sensor = scene->views[i].sensor < sensor ? scene->views[i].sensor : sensor;
  for (int64_t i = 0; i < scene->view_count; i++)
    if (scene->views[i].sensor == sensor)
      list[count++] = &scene->views[i];
  pags_sort(list, count, sizeof *list, compare_times);
  for (int64_t i = 0; i < count; i++) {
    times[i] = list[i]->camera.time - time_zero;
    turn(scene, list[i]->camera.world_from_camera, order, sign, poses[i]);
  }
  int node = pags_gltf_node(gltf, parent, "ego");
  pags_gltf_node_pose(gltf, node, poses[0]);
  if (times[count - 1] > times[0])
    pags_gltf_node_track(gltf, node, count, times, (const double(*)[12])poses);
  return PAGS_OK;
}

pags_result pags_gltf_add_views(pags_gltf *gltf, int parent, const pags_scene *scene, double time_zero) {
  if (!scene->view_count)
    return PAGS_OK;
  int64_t kind_count = 0, bent = 0;
  for (int64_t i = 0; i < scene->view_count; i++)
    bent += pags_camera_bends(&scene->views[i].camera);
  if (bent)
    PAGS_WARN(
        "glTF has no lenses: %lld of %lld cameras are pinholes of the same focal lengths there; their lens is in the "
        "extras",
        (long long)bent, (long long)scene->view_count);
  PAGS_AUTOFREE kind *kinds = malloc((size_t)scene->view_count * sizeof *kinds);
  PAGS_CHECK_MEMORY(kinds, "%lld views", (long long)scene->view_count);
  int group = pags_gltf_node(gltf, parent, "cameras");
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *view = &scene->views[i];
    PAGS_TRY(add_view(gltf, group, scene, view, camera_of(gltf, kinds, &kind_count, &view->camera), time_zero));
  }
  return add_ego(gltf, parent, scene, time_zero);
}
