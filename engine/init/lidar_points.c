/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the LiDAR sweeps of the training time steps and assigns each point to the object in whose box it lies, or to
 * the background. */
#include "init/lidar_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* Margin, metres, by which labelled boxes are enlarged on every side: they are drawn too small as often as too large,
 * and mirrors stick out. */
static const double slack = 0.1;
/* Points in the lowest layer of a box, of this height in metres, belong to the road. */
static const double ground = 0.08;

pags_result pags_lidar_points_reserve(pags_lidar_points *self, int64_t room) {
  if (room <= self->room)
    return PAGS_OK;
  int64_t grown = self->room + self->room / 2 > room ? self->room + self->room / 2 : room;
  pags_lidar_point *rows = realloc(self->rows, (size_t)grown * sizeof *rows);
  if (!rows)
    return pags_out_of_memory("%lld points", (long long)grown);
  self->rows = rows;
  self->room = grown;
  return PAGS_OK;
}

void pags_lidar_points_destroy(pags_lidar_points *self) {
  free(self->rows);
  *self = (pags_lidar_points){0};
}

/* An object's box, posed at the time of a sweep. */
typedef struct box {
  int32_t object;
  int moving;
  double object_from_sweep[12];
  double half[3];   /* half of its enlarged sides, metres */
  double reach2;    /* squared radius of its bounding sphere */
  double middle[3]; /* its centre in the sweep's frame */
} box;

/* Lists the boxes at the time of a sweep and returns their number. Boxes of moving objects come first: where boxes
 * overlap, a point belongs to the moving object. */
static int list_boxes(const pags_dataset *dataset, const pags_sweep *sweep, box *boxes) {
  int count = 0;
  for (int moving = 1; moving >= 0; moving--)
    for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
      const pags_object *object = pags_dataset_object(dataset, i);
      double pose[12], inverse[12], sweep_from_object[12];
      if ((object->moving != 0) != moving || !pags_object_pose(object, sweep->time, pose))
        continue;
      box *b = &boxes[count++];
      b->object = (int32_t)i;
      b->moving = moving;
      b->reach2 = 0;
      pags_rigid_inverse(pose, inverse);
      pags_rigid_multiply(inverse, sweep->world_from_sweep, b->object_from_sweep);
      pags_rigid_inverse(b->object_from_sweep, sweep_from_object);
      for (int k = 0; k < 3; k++) {
        b->half[k] = 0.5 * object->size[k] + slack;
        b->reach2 += b->half[k] * b->half[k];
        b->middle[k] = sweep_from_object[4 * k + 3];
      }
    }
  return count;
}

/* Returns the first box that contains p (in the sweep's frame), NULL if none does; `local` is p in the box's
 * frame. */
static const box *find_box(const box *boxes, int count, const double p[3], double local[3]) {
  for (int i = 0; i < count; i++) {
    const box *b = &boxes[i];
    double x = p[0] - b->middle[0], y = p[1] - b->middle[1], z = p[2] - b->middle[2];
    if (x * x + y * y + z * z > b->reach2)
      continue;
    pags_rigid_point(b->object_from_sweep, p, local);
    if (fabs(local[0]) <= b->half[0] && fabs(local[1]) <= b->half[1] && local[2] <= b->half[2] &&
        local[2] >= ground + slack - b->half[2])
      return b;
  }
  return NULL;
}

typedef struct gathering {
  const pags_dataset *dataset;
  const pags_sweep *sweep;
  const float *xyz;
  const box *boxes;
  int box_count;
  int64_t keep, of; /* of the background, keep out of `of` points are taken, spread evenly */
  float time;
  pags_lidar_point *rows; /* one for each point of the sweep; kind -1: left out */
} gathering;

static void classify_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const gathering *g = context;
  const double *origin = pags_dataset_origin(g->dataset);
  for (int64_t i = begin; i < end; i++) {
    double p[3] = {(double)g->xyz[3 * i], (double)g->xyz[3 * i + 1], (double)g->xyz[3 * i + 2]}, local[3];
    const box *b = find_box(g->boxes, g->box_count, p, local);
    pags_lidar_point row = {.time = g->time, .owner = -1, .parked = -1, .source = -1, .merged = 1};
    if (b && b->moving)
      row.owner = b->object;
    else if (b)
      row.parked = b->object;
    if (row.owner < 0) {
      pags_rigid_point(g->sweep->world_from_sweep, p, local);
      if (!(i * g->keep / g->of != (i + 1) * g->keep / g->of))
        row.kind = -1;
    }
    for (int k = 0; k < 3; k++)
      row.p[k] = (float)(row.owner < 0 ? local[k] - origin[k] : local[k]);
    g->rows[i] = row;
  }
}

static pags_result gather_sweep(gathering *g, pags_tasks *tasks, box *boxes, int64_t index, pags_lidar_points *out) {
  int64_t count;
  float *xyz;
  g->sweep = pags_dataset_sweep(g->dataset, index);
  PAGS_TRY(pags_dataset_sweep_load(g->dataset, index, &count, &xyz));
  g->xyz = xyz;
  g->boxes = boxes;
  g->box_count = list_boxes(g->dataset, g->sweep, boxes);
  g->time = (float)(g->sweep->time - pags_dataset_sweep(g->dataset, 0)->time);
  g->of = count > 0 ? count : 1;
  int64_t share = g->keep;
  g->keep = share < g->of ? share : g->of;
  pags_result result = pags_lidar_points_reserve(out, out->count + count);
  if (result == PAGS_OK) {
    g->rows = out->rows + out->count;
    if (!pags_parallel_for(tasks, count, 4096, classify_block, g))
      result = pags_fail(PAGS_CANCELLED, "cancelled while reading LiDAR");
  }
  g->keep = share;
  free(xyz);
  for (int64_t i = 0; result == PAGS_OK && i < count; i++)
    if (g->rows[i].kind >= 0)
      out->rows[out->count++] = g->rows[i];
  return result;
}

pags_result pags_lidar_points_gather(const pags_dataset *dataset, pags_tasks *tasks, int64_t most,
                                     pags_lidar_points *out) {
  int64_t sweeps = 0, objects = pags_dataset_object_count(dataset);
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset); i++)
    sweeps += !pags_dataset_sweep(dataset, i)->test;
  if (sweeps == 0)
    return PAGS_OK;
  box *boxes = malloc((size_t)(objects > 0 ? objects : 1) * sizeof *boxes);
  if (!boxes)
    return pags_out_of_memory("%lld boxes", (long long)objects);
  gathering g = {.dataset = dataset, .keep = most / sweeps > 0 ? most / sweeps : 1};
  pags_result result = PAGS_OK;
  for (int64_t i = 0; result == PAGS_OK && i < pags_dataset_sweep_count(dataset); i++)
    if (!pags_dataset_sweep(dataset, i)->test)
      result = gather_sweep(&g, tasks, boxes, i, out);
  free(boxes);
  return result;
}
