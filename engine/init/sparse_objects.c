/* SPDX-License-Identifier: Apache-2.0 */
/* Completes moving objects that have few LiDAR points by mirror images of these points and by grids of points. */
#include <math.h>

#include "base/memory.h"
#include "init/lidar_points.h"

enum { GRID = 8 }; /* points along each side of a box */

/* Thins the points of object `owner` to an even choice of at most `most`; returns how many are left. */
static int64_t thin(pags_lidar_points *points, int32_t owner, int64_t most) {
  int64_t all = 0, seen = 0, kept = 0;
  for (int64_t i = 0; i < points->count; i++)
    all += points->rows[i].owner == owner;
  if (all <= most)
    return all;
  for (int64_t i = 0; i < points->count; i++) {
    if (points->rows[i].owner == owner) {
      int64_t at = seen++;
      if (at * most / all == (at + 1) * most / all)
        continue;
    }
    points->rows[kept++] = points->rows[i];
  }
  points->count = kept;
  return most;
}

pags_result pags_lidar_points_complete(const pags_dataset *dataset, int64_t most, int64_t few,
                                       pags_lidar_points *points) {
  /* All objects are thinned before any is mirrored: a mirrored point stores the row of its source, which thinning
   * would move. */
  const int64_t objects = pags_dataset_object_count(dataset);
  PAGS_AUTOFREE int64_t *measured = malloc((size_t)(objects > 0 ? objects : 1) * sizeof *measured);
  PAGS_CHECK_MEMORY(measured, "%lld objects", (long long)objects);
  for (int64_t i = 0; i < objects; i++)
    measured[i] = pags_dataset_object(dataset, i)->moving ? thin(points, (int32_t)i, most) : most;
  for (int64_t owner = 0; owner < objects; owner++) {
    const pags_object *object = pags_dataset_object(dataset, owner);
    const bool vehicle = object->category == PAGS_CATEGORY_VEHICLE;
    const int64_t count = points->count;
    if (!object->moving || measured[owner] >= few)
      continue;
    for (int64_t i = 0; vehicle && i < count; i++) {
      if (points->rows[i].owner != owner)
        continue;
      PAGS_TRY(pags_lidar_points_reserve(points, points->count + 1));
      pags_lidar_point row = points->rows[i];
      row.p[1] = -row.p[1];
      row.kind = PAGS_CANDIDATE_MIRRORED;
      row.source = (int32_t)i;
      points->rows[points->count++] = row;
    }
    PAGS_TRY(pags_lidar_points_reserve(points, points->count + (int64_t)GRID * GRID * GRID));
    for (int n = 0; n < GRID * GRID * GRID; n++) {
      const int step[3] = {n % GRID, n / GRID % GRID, n / (GRID * GRID)};
      double at[3];
      for (int k = 0; k < 3; k++)
        at[k] = 0.9 * (2.0 * step[k] + 1 - GRID) / (GRID - 1); /* -0.9 .. 0.9 of half the size */
      /* For people, points in the corners of the box are left out. */
      if (!vehicle && at[0] * at[0] + at[1] * at[1] > 0.7 * 0.7)
        continue;
      pags_lidar_point row = {.owner = (int32_t)owner,
                              .parked = -1,
                              .source = -1,
                              .kind = PAGS_CANDIDATE_GRID,
                              .time = NAN /* it was not measured at any time */};
      for (int k = 0; k < 3; k++)
        row.p[k] = (float)(0.5 * at[k] * object->size[k]);
      points->rows[points->count++] = row;
    }
  }
  return PAGS_OK;
}
