/* SPDX-License-Identifier: Apache-2.0 */
/* Compares a ground mesh with the ground points of LiDAR sweeps. The ground is found from the sweep alone, by region
 * growing: half-metre cells whose points are nearly level and outside of labelled boxes, connected to the cameras'
 * surroundings without a step of more than 12 cm. */
#include "benchmarks/exporters/lidar_ground.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

#include <pags/dataset.h>

/* SIDE: cells per side of the grid; WINDOW: neighbourhood in cells, not 1 because LiDAR rings have gaps */
enum { SIDE = 100, WINDOW = 3 };
/* metres: size of a cell, height range of a level cell, step between neighbours, margin of boxes, radius of the
 * seeds */
static const double cell = 0.5, level = 0.12, step = 0.12, box_margin = 0.2, seeds = 10;

typedef struct patch {
  double lo, hi, sum;
  int64_t count;
  int ground;
} patch;

static int64_t patch_of(const double middle[3], const double p[3]) {
  double i = floor((p[0] - middle[0]) / cell) + SIDE / 2, j = floor((p[1] - middle[1]) / cell) + SIDE / 2;
  return i >= 0 && j >= 0 && i < SIDE && j < SIDE ? (int64_t)j * SIDE + (int64_t)i : -1;
}

static bool is_level(const patch *c) {
  return c->count >= 3 && c->hi - c->lo < level;
}

static bool in_box(const pags_scene *scene, double time, const double p[3]) {
  for (int64_t o = 0; o < scene->object_count; o++) {
    double pose[12], back[12];
    const pags_object *record = &scene->objects[o].record;
    int inside = pags_object_pose(record, time, pose);
    if (!inside || pags_hypot(pose[3] - p[0], pose[7] - p[1]) > record->size[0] + record->size[1])
      continue;
    pags_rigid_inverse(pose, back);
    for (int k = 0; k < 3; k++)
      inside = inside && fabs(back[4 * k] * p[0] + back[4 * k + 1] * p[1] + back[4 * k + 2] * p[2] + back[4 * k + 3]) <
                             0.5 * record->size[k] + box_margin;
    if (inside)
      return true;
  }
  return false;
}

/* Computes the mean position of the cameras of a time step; returns 0 if it has none. */
static int find_middle(const pags_scene *scene, int frame, double middle[3]) {
  int count = 0;
  memset(middle, 0, 3 * sizeof *middle);
  for (int64_t i = 0; i < scene->view_count; i++)
    if (scene->views[i].frame == frame) {
      count++;
      for (int k = 0; k < 3; k++)
        middle[k] += scene->views[i].camera.world_from_camera[4 * k + 3];
    }
  for (int k = 0; k < 3; k++)
    middle[k] /= count ? count : 1;
  return count;
}

/* Marks the ground cells by region growing. Seeds are the level cells within 10 m whose mean height is within 0.2 m
 * of the lower quartile of these cells' heights, which excludes the roof of the ego vehicle. */
static void grow(patch *patches) {
  static double heights[SIDE * SIDE];
  static int queue[SIDE * SIDE];
  int count = 0, head = 0;
  for (int i = 0; i < SIDE * SIDE; i++)
    if (is_level(&patches[i]) && pags_hypot(i % SIDE - SIDE / 2, i / SIDE - SIDE / 2) * cell < seeds)
      heights[count++] = patches[i].sum / (double)patches[i].count;
  if (!count)
    return;
  pags_sort_doubles(heights, count);
  double below = heights[count / 4];
  count = 0;
  for (int i = 0; i < SIDE * SIDE; i++)
    if (is_level(&patches[i]) && pags_hypot(i % SIDE - SIDE / 2, i / SIDE - SIDE / 2) * cell < seeds &&
        fabs(patches[i].sum / (double)patches[i].count - below) < 0.2) {
      patches[i].ground = 1;
      queue[count++] = i;
    }
  for (; head < count; head++)
    for (int dy = -WINDOW; dy <= WINDOW; dy++)
      for (int dx = -WINDOW; dx <= WINDOW; dx++) {
        int x = queue[head] % SIDE + dx, y = queue[head] / SIDE + dy, at = y * SIDE + x;
        if (x < 0 || y < 0 || x >= SIDE || y >= SIDE || patches[at].ground || !is_level(&patches[at]) ||
            fabs(patches[at].sum / (double)patches[at].count -
                 patches[queue[head]].sum / (double)patches[queue[head]].count) > step)
          continue;
        patches[at].ground = 1;
        queue[count++] = at;
      }
}

static void to_world(const pags_sweep *sweep, const float *xyz, double out[3]) {
  const double *m = sweep->world_from_sweep;
  for (int k = 0; k < 3; k++)
    out[k] = m[4 * k] * (double)xyz[0] + m[4 * k + 1] * (double)xyz[1] + m[4 * k + 2] * (double)xyz[2] + m[4 * k + 3];
}

static pags_result measure_sweep(const pags_scene *scene, const pags_mesh_query *ground, const pags_sweep *sweep,
                                 const float *xyz, int64_t count, double **errors, int64_t *error_count,
                                 pags_lidar_ground *out) {
  static patch patches[SIDE * SIDE];
  double middle[3], p[3];
  if (!find_middle(scene, sweep->frame, middle))
    return PAGS_OK;
  double *grown = realloc(*errors, (size_t)(*error_count + count + 1) * sizeof *grown);
  if (!grown)
    return pags_out_of_memory("%lld heights", (long long)(*error_count + count));
  *errors = grown;
  memset(patches, 0, sizeof patches);
  for (int64_t i = 0; i < count; i++) {
    to_world(sweep, xyz + 3 * i, p);
    int64_t at = patch_of(middle, p);
    if (at < 0 || in_box(scene, sweep->time, p))
      continue;
    patch *c = &patches[at];
    c->lo = c->count ? fmin(c->lo, p[2]) : p[2];
    c->hi = c->count ? fmax(c->hi, p[2]) : p[2];
    c->sum += p[2];
    c->count++;
  }
  grow(patches);
  out->sweeps++;
  for (int64_t i = 0; i < count; i++) {
    to_world(sweep, xyz + 3 * i, p);
    int64_t at = patch_of(middle, p);
    if (at < 0 || !patches[at].ground || in_box(scene, sweep->time, p))
      continue;
    const double from[3] = {p[0] - scene->origin[0], p[1] - scene->origin[1], 1000}, down[3] = {0, 0, -1};
    double t = pags_mesh_query_ray(ground, from, down, NULL);
    out->points++;
    if (t > 0)
      (*errors)[(*error_count)++] = fabs(1000 - t + scene->origin[2] - p[2]);
    else
      out->missed++;
  }
  return PAGS_OK;
}

pags_result pags_lidar_ground_measure(const pags_scene *scene, const pags_mesh_query *ground, pags_lidar_ground *out) {
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset;
  double *errors = NULL;
  int64_t error_count = 0;
  *out = (pags_lidar_ground){.error = {(double)NAN, (double)NAN, (double)NAN}};
  if (!scene->dataset)
    return PAGS_OK;
  PAGS_TRY(pags_dataset_open(scene->dataset, &options, &dataset));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset) && result == PAGS_OK; i++) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, i);
    float *xyz = NULL;
    int64_t count;
    if (!sweep->test)
      continue;
    result = pags_dataset_sweep_load(dataset, i, &count, &xyz);
    if (result == PAGS_OK)
      result = measure_sweep(scene, ground, sweep, xyz, count, &errors, &error_count, out);
    free(xyz);
  }
  pags_dataset_close(dataset);
  if (result == PAGS_OK)
    out->error = pags_distance_summary(errors, error_count);
  free(errors);
  return result;
}
