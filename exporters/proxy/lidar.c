/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the LiDAR sweeps of a scene's data set and separates their points: points in labelled boxes are kept per
 * object, for lidar_fit.c; the rest are kept as one cloud, of which ground.c takes the ground's heights. */
#include <pags/dataset.h>

#include "exporters/proxy/lidar.h"

#include <math.h>
#include <stdlib.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "dataset/owners.h"
#include "maths/maths.h"

void pags_lidar_destroy(pags_lidar *lidar) {
  for (int64_t i = 0; lidar->objects && i < lidar->object_count; i++)
    pags_lidar_fit_destroy(&lidar->objects[i]);
  free(lidar->objects);
  free(lidar->points);
  *lidar = (pags_lidar){0};
}

#ifdef PAGS_WITH_DATASET

/* In metres. Points within `box_margin` of a labelled box are not the background's. Those within
 * `own_margin` of the box are the object's, if they lie `stand` or more above the box's lower face: a kerb may be
 * below. */
static const double box_margin = 0.2, own_margin = 0.1, stand = 0.3;

/* A labelled box at the time of one sweep. `radius` is of a circle about `middle`, seen from above, that holds it. */
typedef struct box {
  int64_t object;
  double middle[2], radius, half[3], box_from_world[12];
} box;

/* Lists the labelled boxes that exist at `time`; returns how many. */
static int64_t find_boxes(const pags_scene *scene, double time, box *boxes) {
  int64_t count = 0;
  for (int64_t o = 0; o < scene->object_count; o++) {
    const pags_object *record = &scene->objects[o].record;
    double pose[12];
    if (!pags_object_pose(record, time, pose))
      continue;
    box *b = &boxes[count++];
    b->object = o;
    b->middle[0] = pose[3];
    b->middle[1] = pose[7];
    b->radius = 0.5 * pags_hypot(record->size[0], record->size[1]) + 2 * box_margin;
    pags_scale3(0.5, record->size, b->half);
    pags_rigid_inverse(pose, b->box_from_world);
  }
  return count;
}

/* Adds a point to the points of the object in whose box it lies, if any. `taken` receives whether it lies in or near
 * a box and is therefore not the background's. */
static pags_result sort_point(const box *boxes, int64_t count, const double p[3], pags_lidar *out, bool *taken) {
  *taken = false;
  for (int64_t i = 0; i < count; i++) {
    const box *b = &boxes[i];
    double q[3], beyond = -HUGE_VAL;
    if (!(fabs(p[0] - b->middle[0]) <= b->radius && fabs(p[1] - b->middle[1]) <= b->radius))
      continue;
    pags_rigid_point(b->box_from_world, p, q);
    for (int k = 0; k < 3; k++)
      beyond = fmax(beyond, fabs(q[k]) - b->half[k]);
    if (beyond >= box_margin)
      continue;
    *taken = true;
    if (beyond < own_margin && q[2] > stand - b->half[2])
      return pags_lidar_fit_add(&out->objects[b->object], q);
  }
  return PAGS_OK;
}

/* Whether the sweep belongs to a time step of which the scene has a held-out view. The scene decides, since the data
 * set could be split otherwise now. */
static bool is_held_out(const pags_scene *scene, const pags_sweep *sweep) {
  for (int64_t i = 0; i < scene->view_count; i++)
    if (scene->views[i].frame == sweep->frame && scene->views[i].test)
      return true;
  return false;
}

static pags_result add_sweep(const pags_scene *scene, pags_dataset *dataset, int64_t index, const box *boxes,
                             int64_t box_count, pags_lidar *out) {
  const pags_sweep *sweep = pags_dataset_sweep(dataset, index);
  PAGS_AUTOFREE float *xyz = NULL;
  int64_t count = 0, capacity = out->count;
  PAGS_TRY(pags_dataset_sweep_load(dataset, index, &count, &xyz));
  PAGS_CHECK_MEMORY(pags_grow(&out->points, out->count + count + 1, &capacity, 3 * sizeof *out->points), "%lld points",
                    (long long)(out->count + count));
  for (int64_t i = 0; i < count; i++) {
    double own[3], p[3];
    bool taken;
    pags_widen3(xyz + 3 * i, own);
    pags_rigid_point(sweep->world_from_sweep, own, p);
    PAGS_TRY(sort_point(boxes, box_count, p, out, &taken));
    if (taken)
      continue;
    pags_subtract3(p, scene->origin, p);
    pags_narrow3(p, out->points + 3 * out->count++);
  }
  return PAGS_OK;
}

static pags_result read_sweeps(const pags_scene *scene, pags_dataset *dataset, bool held_out, pags_lidar *out) {
  PAGS_AUTOFREE box *boxes = malloc(((size_t)scene->object_count + 1) * sizeof *boxes);
  out->object_count = scene->object_count;
  out->objects = calloc((size_t)scene->object_count + 1, sizeof *out->objects);
  PAGS_CHECK_MEMORY(boxes && out->objects, "%lld boxes", (long long)scene->object_count);
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset); i++) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, i);
    if (is_held_out(scene, sweep) == held_out)
      PAGS_TRY(add_sweep(scene, dataset, i, boxes, find_boxes(scene, sweep->time, boxes), out));
  }
  return PAGS_OK;
}

pags_result pags_lidar_read(const pags_scene *scene, bool held_out, pags_lidar *out) {
  pags_dataset_options options = pags_dataset_options_default();
  PAGS_AUTO(pags_dataset_close_auto) pags_dataset *dataset = NULL;
  *out = (pags_lidar){0};
  if (!scene->dataset || !(scene->fps > 0)) /* captures have no LiDAR */
    return PAGS_OK;
  options.image_folder = scene->image_folder;
  options.image_alpha = (pags_image_alpha)scene->image_alpha;
  pags_result result = pags_dataset_open(scene->dataset, &options, &dataset);
  if (result == PAGS_OK && (pags_dataset_provides(dataset) & PAGS_PROVIDES_LIDAR))
    result = read_sweeps(scene, dataset, held_out, out);
  if (result == PAGS_OK)
    return PAGS_OK;
  pags_lidar_destroy(out);
  if (result == PAGS_ERROR_MEMORY)
    return result;
  pags_log_message(PAGS_LOG_INFO, "proxies do without LiDAR: %s", pags_error_message());
  return PAGS_OK;
}

#else

pags_result pags_lidar_read(const pags_scene *scene, bool held_out, pags_lidar *out) {
  (void)scene, (void)held_out;
  *out = (pags_lidar){0};
  return PAGS_OK;
}

#endif
