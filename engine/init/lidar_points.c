/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the LiDAR sweeps of the training time steps and assigns each point to the object in whose box it lies, or to
 * the background. */
#include "init/lidar_points.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"

/* Margin, metres, by which labelled boxes are enlarged on every side: they are drawn too small as often as too large,
 * and mirrors stick out. */
static const double slack = 0.1;
/* Points in the lowest layer of a box, of this height in metres, belong to the road. */
static const double ground = 0.08;

pags_result pags_lidar_points_reserve(pags_lidar_points *points, int64_t room) {
  PAGS_CHECK_MEMORY(pags_grow(&points->rows, room, &points->room, sizeof *points->rows), "%lld points",
                    (long long)room);
  return PAGS_OK;
}

void pags_lidar_points_destroy(pags_lidar_points *points) {
  free(points->rows);
  *points = (pags_lidar_points){0};
}

/* An object's box, posed at the time of a sweep. */
typedef struct box {
  int32_t object;
  bool moving;
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
      pags_rigid_inverse(pose, inverse);
      pags_rigid_multiply(inverse, sweep->world_from_sweep, b->object_from_sweep);
      pags_rigid_inverse(b->object_from_sweep, sweep_from_object);
      for (int k = 0; k < 3; k++)
        b->half[k] = 0.5 * object->size[k] + slack;
      b->reach2 = pags_dot3(b->half, b->half);
      pags_pose_position(sweep_from_object, b->middle);
    }
  return count;
}

/* Returns the first box that contains p (in the sweep's frame), NULL if none does; `local` is p in the box's
 * frame. */
static const box *find_box(const box *boxes, int count, const double p[3], double local[3]) {
  for (int i = 0; i < count; i++) {
    const box *b = &boxes[i];
    if (pags_distance_squared3(p, b->middle) > b->reach2)
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

static void classify_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const gathering *g = context;
  const double *origin = pags_dataset_origin(g->dataset);
  for (int64_t i = begin; i < end; i++) {
    double p[3], local[3];
    pags_widen3(g->xyz + 3 * i, p);
    const box *b = find_box(g->boxes, g->box_count, p, local);
    pags_lidar_point row = {.time = g->time,
                            .owner = b && b->moving ? b->object : -1,
                            .parked = b && !b->moving ? b->object : -1,
                            .source = -1,
                            .merged = 1};
    if (row.owner < 0) {
      pags_rigid_point(g->sweep->world_from_sweep, p, local);
      pags_subtract3(local, origin, local);
      if (i * g->keep / g->of == (i + 1) * g->keep / g->of)
        row.kind = -1;
    }
    pags_narrow3(local, row.p);
    g->rows[i] = row;
  }
}

pags_result pags_lidar_points_gather(const pags_dataset *dataset, pags_tasks *tasks, int64_t most,
                                     pags_lidar_points *out) {
  int64_t sweeps = 0, objects = pags_dataset_object_count(dataset);
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset); i++)
    sweeps += !pags_dataset_sweep(dataset, i)->test;
  if (sweeps == 0)
    return PAGS_OK;
  const int64_t share = most / sweeps > 0 ? most / sweeps : 1;
  PAGS_AUTOFREE box *boxes = malloc((size_t)(objects > 0 ? objects : 1) * sizeof *boxes);
  PAGS_CHECK_MEMORY(boxes, "%lld boxes", (long long)objects);
  for (int64_t n = 0; n < pags_dataset_sweep_count(dataset); n++) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, n);
    if (sweep->test)
      continue;
    int64_t count;
    PAGS_AUTOFREE float *xyz = NULL;
    PAGS_TRY(pags_dataset_sweep_load(dataset, n, &count, &xyz));
    PAGS_TRY(pags_lidar_points_reserve(out, out->count + count));
    gathering g = {.dataset = dataset,
                   .sweep = sweep,
                   .xyz = xyz,
                   .boxes = boxes,
                   .box_count = list_boxes(dataset, sweep, boxes),
                   .of = count > 0 ? count : 1,
                   .time = (float)(sweep->time - pags_dataset_sweep(dataset, 0)->time),
                   .rows = out->rows + out->count};
    g.keep = share < g.of ? share : g.of;
    if (!pags_parallel_for(tasks, count, 4096, classify_block, &g))
      return pags_fail(PAGS_CANCELLED, "cancelled while reading LiDAR");
    for (int64_t i = 0; i < count; i++)
      if (g.rows[i].kind >= 0)
        out->rows[out->count++] = g.rows[i];
  }
  return PAGS_OK;
}
