/* SPDX-License-Identifier: Apache-2.0 */
/* Thins the background's LiDAR points: merges them by voxels that grow with the distance from the cameras, and
 * removes outliers and points of the ego vehicle. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "init/knn.h"
#include "init/lidar_points.h"

enum { LEVELS = 12, BLOCK = 2048 };

static const double finest_until = 10.0; /* metres */

/* A pass over all points. For voxels and outliers it computes each point's level: how many times finest_until must be
 * doubled to reach the distance to the nearest eye. For the ego vehicle, `level` is 1 for points on it. */
typedef struct levels {
  const pags_lidar_point *rows;
  const float *eyes;
  int64_t eye_count;
  uint8_t *level;
} levels;

/* ---- Levels by distance ---- */

static void level_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const levels *l = context;
  for (int64_t i = begin; i < end; i++) {
    const float *p = l->rows[i].p;
    float least = INFINITY;
    for (int64_t e = 0; e < l->eye_count; e++) {
      const float *q = l->eyes + 3 * e;
      float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2], d2 = x * x + y * y + z * z;
      least = d2 < least ? d2 : least;
    }
    double limit = finest_until * finest_until;
    int level = 0;
    while (level < LEVELS - 1 && (double)least > limit) {
      limit *= 4;
      level++;
    }
    l->level[i] = (uint8_t)level;
  }
}

static pags_result find_levels(const pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                               uint8_t **out) {
  *out = malloc((size_t)(points->count > 0 ? points->count : 1));
  if (!*out)
    return pags_out_of_memory("%lld points", (long long)points->count);
  levels l = {points->rows, eyes, eye_count, *out};
  if (pags_parallel_for(tasks, points->count, BLOCK, level_block, &l))
    return PAGS_OK;
  free(*out);
  *out = NULL;
  return pags_fail(PAGS_CANCELLED, "cancelled while thinning points");
}

/* ---- Merging by voxels ---- */

typedef struct key {
  int32_t cell[3];
  int32_t parked;
  int32_t level;
} key;

static key key_of(const pags_lidar_point *row, int level, double side) {
  key k = {.parked = row->parked, .level = level};
  double size = ldexp(side, level);
  for (int i = 0; i < 3; i++)
    k.cell[i] = (int32_t)fmax(-1e9, fmin(1e9, floor((double)row->p[i] / size)));
  return k;
}

static uint64_t hash_of(const key *k) {
  uint64_t h = (uint32_t)k->cell[0];
  h = h * 0x9e3779b97f4a7c15u + (uint32_t)k->cell[1];
  h = h * 0x9e3779b97f4a7c15u + (uint32_t)k->cell[2];
  h = h * 0x9e3779b97f4a7c15u + (uint32_t)(k->parked * LEVELS + k->level);
  h ^= h >> 32;
  h *= 0xd6e8feb86659fd93u;
  return h ^ h >> 29;
}

/* Merges `from` into `to`. Position and time become means weighted by the numbers of measured points; the weighted
 * sums of colours and the counts of views are added. */
static void merge_into(pags_lidar_point *to, const pags_lidar_point *from) {
  float share = from->merged / (to->merged + from->merged);
  for (int k = 0; k < 3; k++)
    to->p[k] += share * (from->p[k] - to->p[k]);
  to->time += share * (from->time - to->time);
  for (int k = 0; k < 4; k++)
    to->sum[k] += from->sum[k];
  for (int k = 0; k < 2; k++)
    to->views[k] += from->views[k];
  to->merged += from->merged;
}

pags_result pags_lidar_points_merge(pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                                    double side) {
  uint8_t *level;
  uint64_t size = 16;
  if (points->count > INT32_MAX / 4)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld points are too many to thin", (long long)points->count);
  while (size < 2 * (uint64_t)points->count)
    size *= 2;
  PAGS_TRY(find_levels(points, tasks, eyes, eye_count, &level));
  int32_t *table = malloc(size * sizeof *table);
  key *keys = malloc((size_t)(points->count > 0 ? points->count : 1) * sizeof *keys);
  pags_result result = PAGS_OK;
  if (!table || !keys) {
    result = pags_out_of_memory("%lld voxels", (long long)points->count);
  } else {
    memset(table, 0xff, size * sizeof *table);

    /* Each point of the background is merged into the first one of its voxel; all other rows are kept. */
    uint64_t mask = size - 1;
    int64_t kept = 0;
    for (int64_t i = 0; i < points->count; i++) {
      pags_lidar_point row = points->rows[i];
      if (row.owner < 0) {
        key k = key_of(&row, level[i], side);

        /* Hash table with open addressing: indices of the kept rows; keys[i] is the voxel of kept row i. */
        uint64_t at = hash_of(&k) & mask;
        while (table[at] >= 0 && memcmp(&keys[table[at]], &k, sizeof k) != 0)
          at = (at + 1) & mask;
        int64_t slot = (int64_t)at;

        if (table[slot] >= 0) {
          merge_into(&points->rows[table[slot]], &row);
          continue;
        }
        table[slot] = (int32_t)kept;
        keys[kept] = k;
      }
      points->rows[kept++] = row;
    }
    points->count = kept;
  }
  free(keys);
  free(table);
  free(level);
  return result;
}

/* ---- Points of the ego vehicle ---- */

/* The ego vehicle fills a cylinder about each camera: its radius, and how far it reaches below and above the camera;
 * metres. The road lies lower. */
static const float rig_radius = 1.2f, rig_below = 1.2f, rig_above = 1.5f;

static void rig_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const levels *l = context;
  for (int64_t i = begin; i < end; i++) {
    const float *p = l->rows[i].p;
    l->level[i] = 0;
    for (int64_t e = 0; e < l->eye_count && !l->level[i]; e++) {
      const float *q = l->eyes + 3 * e;
      float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
      l->level[i] = x * x + y * y < rig_radius * rig_radius && z > -rig_below && z < rig_above;
    }
  }
}

pags_result pags_lidar_points_remove_rig(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                         int64_t eye_count) {
  int64_t kept = 0;
  uint8_t *inside = malloc((size_t)(points->count > 0 ? points->count : 1));
  if (!inside)
    return pags_out_of_memory("%lld points", (long long)points->count);
  levels l = {points->rows, eyes, eye_count, inside};
  pags_result result = pags_parallel_for(tasks, points->count, BLOCK, rig_block, &l)
                           ? PAGS_OK
                           : pags_fail(PAGS_CANCELLED, "cancelled while thinning points");
  for (int64_t i = 0; result == PAGS_OK && i < points->count; i++)
    if (points->rows[i].owner >= 0 || !inside[i])
      points->rows[kept++] = points->rows[i];
  if (result == PAGS_OK)
    points->count = kept;
  free(inside);
  return result;
}

/* ---- Outliers ---- */

/* Sets kind = -1 for the outliers among the background's points, whose rows `index` lists. `floats` has room for 5
 * floats a row (position, mean squared distance, scratch), `own` for a level a row. */
static pags_result mark_outliers(pags_lidar_points *points, pags_tasks *tasks, const uint8_t *level,
                                 const int64_t *index, int64_t count, float *floats, uint8_t *own) {
  float *square = floats + 3 * count, limits[LEVELS];
  for (int64_t i = 0; i < count; i++) {
    memcpy(floats + 3 * i, points->rows[index[i]].p, 3 * sizeof *floats);
    own[i] = level[index[i]];
  }
  PAGS_TRY(pags_knn_mean_squared(floats, count, tasks, square));

  /* The limit of each level is sixteen times the median of its mean squared distances; infinity with fewer than 16
   * points. */
  float *scratch = square + count;
  for (int l = 0; l < LEVELS; l++) {
    int64_t n = 0;
    for (int64_t i = 0; i < count; i++)
      if (own[i] == l)
        scratch[n++] = square[i];
    pags_sort_floats(scratch, n);
    limits[l] = n >= 16 ? 16 * scratch[n / 2] : INFINITY;
  }

  for (int64_t i = 0; i < count; i++)
    if (square[i] > limits[own[i]])
      points->rows[index[i]].kind = -1;
  return PAGS_OK;
}

pags_result pags_lidar_points_remove_outliers(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                              int64_t eye_count) {
  uint8_t *level;
  int64_t count = 0, kept = 0;
  PAGS_TRY(find_levels(points, tasks, eyes, eye_count, &level));
  size_t room = (size_t)(points->count > 0 ? points->count : 1);
  int64_t *index = malloc(room * sizeof *index);
  float *floats = malloc(room * 5 * sizeof *floats);
  uint8_t *own = malloc(room);
  for (int64_t i = 0; index && i < points->count; i++)
    if (points->rows[i].owner < 0)
      index[count++] = i;
  pags_result result = index && floats && own ? mark_outliers(points, tasks, level, index, count, floats, own)
                                              : pags_out_of_memory("%lld points", (long long)points->count);
  for (int64_t i = 0; result == PAGS_OK && i < points->count; i++)
    if (points->rows[i].kind >= 0)
      points->rows[kept++] = points->rows[i];
  if (result == PAGS_OK)
    points->count = kept;
  free(own);
  free(floats);
  free(index);
  free(level);
  return result;
}
