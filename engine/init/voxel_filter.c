/* SPDX-License-Identifier: Apache-2.0 */
/* Thins the background's LiDAR points: merges them by voxels that grow with the distance from the cameras, and
 * removes outliers and points of the ego vehicle. */
#include <math.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "init/from_points.h"
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

/* Runs a pass with one byte of `level` per point. The caller frees it, also after a failure. */
static pags_result find_levels(const pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                               pags_block_fn *pass, uint8_t **level) {
  *level = malloc((size_t)(points->count > 0 ? points->count : 1));
  PAGS_CHECK_MEMORY(*level, "%lld points", (long long)points->count);
  levels l = {points->rows, eyes, eye_count, *level};
  return pags_parallel_for(tasks, points->count, BLOCK, pass, &l)
             ? PAGS_OK
             : pags_fail(PAGS_CANCELLED, "cancelled while thinning points");
}

/* ---- Levels by distance ---- */

static void level_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
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

/* ---- Merging by voxels ---- */

typedef struct key {
  int32_t cell[3];
  int32_t parked;
  int32_t level;
} key;

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
  PAGS_AUTOFREE uint8_t *level = NULL;
  uint64_t size = 16;
  if (points->count > INT32_MAX / 4)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld points are too many to thin", (long long)points->count);
  while (size < 2 * (uint64_t)points->count)
    size *= 2;
  PAGS_TRY(find_levels(points, tasks, eyes, eye_count, level_block, &level));
  PAGS_AUTOFREE int32_t *table = malloc(size * sizeof *table);
  PAGS_AUTOFREE key *keys = malloc((size_t)(points->count > 0 ? points->count : 1) * sizeof *keys);
  PAGS_CHECK_MEMORY(table && keys, "%lld voxels", (long long)points->count);
  memset(table, 0xff, size * sizeof *table);

  /* Each point of the background is merged into the first one of its voxel; all other rows are kept. */
  const uint64_t mask = size - 1;
  int64_t kept = 0;
  for (int64_t i = 0; i < points->count; i++) {
    const pags_lidar_point row = points->rows[i];
    if (row.owner < 0) {
      key k = {.parked = row.parked, .level = level[i]};
      for (int axis = 0; axis < 3; axis++)
        k.cell[axis] = (int32_t)fmax(-1e9, fmin(1e9, floor((double)row.p[axis] / ldexp(side, level[i]))));

      /* Hash table with open addressing: indices of the kept rows; keys[i] is the voxel of kept row i. */
      uint64_t at = hash_of(&k) & mask;
      while (table[at] >= 0 && memcmp(&keys[table[at]], &k, sizeof k) != 0)
        at = (at + 1) & mask;
      if (table[at] >= 0) {
        merge_into(&points->rows[table[at]], &row);
        continue;
      }
      table[at] = (int32_t)kept;
      keys[kept] = k;
    }
    points->rows[kept++] = row;
  }
  points->count = kept;
  return PAGS_OK;
}

/* ---- Points of the ego vehicle ---- */

/* The ego vehicle fills a cylinder about each camera: its radius, and how far it reaches below and above the camera;
 * metres. The road lies lower. */
static const float rig_radius = 1.2f, rig_below = 1.2f, rig_above = 1.5f;

static void rig_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
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
  PAGS_AUTOFREE uint8_t *inside = NULL;
  int64_t kept = 0;
  PAGS_TRY(find_levels(points, tasks, eyes, eye_count, rig_block, &inside));
  for (int64_t i = 0; i < points->count; i++)
    if (points->rows[i].owner >= 0 || !inside[i])
      points->rows[kept++] = points->rows[i];
  points->count = kept;
  return PAGS_OK;
}

/* ---- Outliers ---- */

pags_result pags_lidar_points_remove_outliers(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                              int64_t eye_count) {
  PAGS_AUTOFREE uint8_t *level = NULL;
  int64_t count = 0, kept = 0;
  PAGS_TRY(find_levels(points, tasks, eyes, eye_count, level_block, &level));
  const size_t room = (size_t)(points->count > 0 ? points->count : 1);
  PAGS_AUTOFREE int64_t *index = malloc(room * sizeof *index); /* rows of the background */
  PAGS_AUTOFREE float *xyz = malloc(room * 3 * sizeof *xyz);
  PAGS_AUTOFREE float *square = malloc(room * sizeof *square); /* mean squared distances */
  PAGS_AUTOFREE float *scratch = malloc(room * sizeof *scratch);
  PAGS_CHECK_MEMORY(index && xyz && square && scratch, "%lld points", (long long)points->count);
  for (int64_t i = 0; i < points->count; i++)
    if (points->rows[i].owner < 0) {
      pags_copy3f(points->rows[i].p, xyz + 3 * count);
      index[count++] = i;
    }
  PAGS_TRY(pags_knn_mean_squared(xyz, count, tasks, square));

  /* The limit of each level is sixteen times the median of its mean squared distances; infinity with fewer than 16
   * points. */
  float limits[LEVELS];
  for (int l = 0; l < LEVELS; l++) {
    int64_t n = 0;
    for (int64_t i = 0; i < count; i++)
      if (level[index[i]] == l)
        scratch[n++] = square[i];
    pags_sort_floats(scratch, n);
    limits[l] = n >= 16 ? 16 * scratch[n / 2] : INFINITY;
  }
  for (int64_t i = 0; i < count; i++)
    if (square[i] > limits[level[index[i]]])
      points->rows[index[i]].kind = -1;
  for (int64_t i = 0; i < points->count; i++)
    if (points->rows[i].kind >= 0)
      points->rows[kept++] = points->rows[i];
  points->count = kept;
  return PAGS_OK;
}
