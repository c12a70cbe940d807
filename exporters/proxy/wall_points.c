/* SPDX-License-Identifier: Apache-2.0 */
/* Gathers points on walls.
 *
 * A LiDAR point is a wall's if most views that see it show the class of buildings there. Views see it unless their
 * depth is nearer: LiDAR is right about the place, and Gaussians may lie metres behind it. Its normal is level: the
 * minor axis of the points in the columns around it, seen from above, towards the views. */
#include "exporters/proxy/wall_points.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/sort.h"
#include "maths/maths.h"

static const double column = 0.5;  /* side of the columns in which normals are found, metres */
static const double flat = 0.3;    /* largest standard deviation of points across a wall, metres */
static const double vague = 1;     /* a view sees a point if its depth is at most this much nearer, metres and */
static const double vaguer = 0.05; /* of the depth */
static const double foot = 0.2;    /* points lower over the ground are not used, metres */
static const int64_t most_points = 4000000; /* of LiDAR: of more, every second, third, ... is used */

void pags_surface_points_destroy(pags_surface_points *points) {
  free(points->positions);
  free(points->normals);
  *points = (pags_surface_points){0};
}

static pags_result add_point(const float p[3], const double n[3], pags_surface_points *out) {
  int64_t room[2] = {out->capacity, out->capacity};
  PAGS_CHECK_MEMORY(pags_grow(&out->positions, out->count + 1, &room[0], 3 * sizeof(float)) &&
                        pags_grow(&out->normals, out->count + 1, &room[1], 3 * sizeof(float)),
                    "%lld points of walls", (long long)out->count + 1);
  out->capacity = room[1];
  pags_copy3f(p, out->positions + 3 * out->count);
  pags_narrow3(n, out->normals + 3 * out->count++);
  return PAGS_OK;
}

/* The cube of a point, in `axes` dimensions, as a number above 0. */
static uint64_t cube_of(const float p[3], double step, int axes) {
  uint64_t key = 1;
  for (int k = 0; k < axes; k++)
    key = key << 21 | (uint64_t)(fmin(fmax(floor((double)p[k] / step), -1048576), 1048575) + 1048576);
  return key;
}

/* Lists the first point of each cube of side `step`, in ascending order; `kept` is freed by the caller. */
static pags_result thin(const float *points, int64_t count, double step, int64_t **kept, int64_t *kept_count) {
  const int64_t stride = count / most_points + 1;
  uint64_t size = 2;
  while (size < 2 * (uint64_t)(count / stride + 1))
    size *= 2;
  PAGS_AUTOFREE uint64_t *table = calloc(size, sizeof *table);
  *kept = malloc((size_t)(count / stride + 1) * sizeof **kept);
  *kept_count = 0;
  PAGS_CHECK_MEMORY(table && *kept, "%lld points", (long long)count);
  for (int64_t i = 0; i < count; i += stride) {
    const uint64_t key = cube_of(points + 3 * i, step, 3);
    uint64_t at = key * 0x9e3779b97f4a7c15u >> 20 & (size - 1);
    while (table[at] && table[at] != key)
      at = (at + 1) & (size - 1);
    if (table[at])
      continue;
    table[at] = key;
    (*kept)[(*kept_count)++] = i;
  }
  return PAGS_OK;
}

/* ---- LiDAR ---- */

/* A LiDAR point of a wall, and the sum of the directions to the views that say so. */
typedef struct wall_point {
  float p[3], towards[2];
  bool wall;
} wall_point;

typedef struct asking {
  const pags_background *background;
  const pags_ground *ground;
  wall_point *points;
} asking;

static void ask_views(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const asking *a = context;
  const pags_depth_views *views = &a->background->depth_views;
  for (int64_t i = begin; i < end; i++) {
    wall_point *own = &a->points[i];
    double p[3], eye[3], z;
    int walls = 0, others = 0, x, y;
    pags_widen3(own->p, p);
    if (pags_ground_nearest(a->ground, p[0], p[1], &z) && p[2] < z + foot)
      continue;
    for (int64_t v = 0; v < views->count; v++) {
      const pags_depth_view *view = &views->list[v];
      if (!view->labels || !pags_depth_view_project(view, p, &x, &y, &z))
        continue;
      const int64_t pixel = (int64_t)y * view->camera.width + x;
      const double depth = fabs((double)view->depth[pixel]);
      const uint8_t class = pags_class_of_label(view->labels[pixel]);
      /* Sky, people and vehicles tell nothing of the point. */
      if (class >= PAGS_CHUNK_SURFACE || (depth > 0 && depth < z - vague - vaguer * z))
        continue;
      walls += class == PAGS_CHUNK_BUILDING;
      others += class != PAGS_CHUNK_BUILDING;
      pags_pose_position(view->camera.world_from_camera, eye);
      const double far = pags_hypot(eye[0] - p[0], eye[1] - p[1]) + 1e-9;
      for (int k = 0; k < 2; k++)
        own->towards[k] += (float)((eye[k] - p[k]) / far);
    }
    own->wall = walls > others;
  }
}

/* Moments of the points of a column. */
typedef struct moments {
  uint64_t key;
  double n, x, y, xx, xy, yy;
} moments;

static int compare_moments(const void *left, const void *right) {
  const moments *a = left, *b = right;
  return (a->key > b->key) - (a->key < b->key);
}

/* Sums up the points of each column, in the order of columns; returns how many columns there are. */
static int64_t sum_columns(const wall_point *points, int64_t count, moments *out) {
  int64_t kept = 0;
  for (int64_t i = 0; i < count; i++)
    if (points[i].wall) {
      const double x = (double)points[i].p[0], y = (double)points[i].p[1];
      out[kept++] = (moments){cube_of(points[i].p, column, 2), 1, x, y, x * x, x * y, y * y};
    }
  pags_sort(out, kept, sizeof *out, compare_moments);
  int64_t last = 0;
  for (int64_t i = 1; i < kept; i++)
    if (out[i].key != out[last].key) {
      out[++last] = out[i];
    } else {
      out[last].n++;
      out[last].x += out[i].x;
      out[last].y += out[i].y;
      out[last].xx += out[i].xx;
      out[last].xy += out[i].xy;
      out[last].yy += out[i].yy;
    }
  return kept ? last + 1 : 0;
}

/* The level normal of the points in the 3 x 3 columns around a point; false if they are no wall. */
static bool find_normal(const wall_point *point, const moments *columns, int64_t count, double normal[3]) {
  moments sum = {0};
  for (int dx = -1; dx <= 1; dx++)
    for (int dy = -1; dy <= 1; dy++) {
      const float at[3] = {point->p[0] + (float)(dx * column), point->p[1] + (float)(dy * column), 0};
      const moments key = {.key = cube_of(at, column, 2)};
      const moments *found = count ? bsearch(&key, columns, (size_t)count, sizeof key, compare_moments) : NULL;
      if (!found)
        continue;
      sum.n += found->n;
      sum.x += found->x;
      sum.y += found->y;
      sum.xx += found->xx;
      sum.xy += found->xy;
      sum.yy += found->yy;
    }
  const double xx = sum.xx / sum.n - sum.x * sum.x / sum.n / sum.n, xy = sum.xy / sum.n - sum.x * sum.y / sum.n / sum.n,
               yy = sum.yy / sum.n - sum.y * sum.y / sum.n / sum.n;
  const double angle = 0.5 * pags_atan2(2 * xy, xx - yy); /* of the major axis */
  normal[0] = -pags_sin(angle);
  normal[1] = pags_cos(angle);
  normal[2] = 0;
  if (normal[0] * (double)point->towards[0] + normal[1] * (double)point->towards[1] < 0)
    pags_scale3(-1, normal, normal);
  const double across = normal[0] * normal[0] * xx + 2 * normal[0] * normal[1] * xy + normal[1] * normal[1] * yy;
  return sum.n >= 6 && across < flat * flat;
}

pags_result pags_wall_points_of_lidar(const pags_proxy_maker *w, const pags_background *b, const pags_ground *ground,
                                      double step, pags_surface_points *out) {
  *out = (pags_surface_points){.area = step * step};
  PAGS_AUTOFREE int64_t *kept = NULL;
  int64_t count;
  PAGS_TRY(thin(w->lidar.points, w->lidar.count, step, &kept, &count));
  PAGS_AUTOFREE wall_point *points = calloc((size_t)count + 1, sizeof *points);
  PAGS_AUTOFREE moments *columns = malloc(((size_t)count + 1) * sizeof *columns);
  PAGS_CHECK_MEMORY(points && columns, "%lld LiDAR points", (long long)count);
  for (int64_t i = 0; i < count; i++)
    pags_copy3f(w->lidar.points + 3 * kept[i], points[i].p);
  asking a = {b, ground, points};
  PAGS_TRY(pags_proxy_for(w->tasks, count, 1024, ask_views, &a));
  const int64_t column_count = sum_columns(points, count, columns);
  for (int64_t i = 0; i < count; i++) {
    double normal[3];
    if (points[i].wall && find_normal(&points[i], columns, column_count, normal))
      PAGS_TRY(add_point(points[i].p, normal, out));
  }
  return PAGS_OK;
}

/* ---- The fused surface ---- */

pags_result pags_wall_points_of_surface(const pags_proxy_mesh *surface, double step, pags_surface_points *out) {
  PAGS_AUTOFREE int64_t *kept = NULL;
  PAGS_AUTOFREE float *normals = malloc((3 * (size_t)surface->vertex_count + 1) * sizeof *normals);
  int64_t count;
  *out = (pags_surface_points){.area = step * step};
  PAGS_CHECK_MEMORY(normals, "%lld points of walls", (long long)surface->vertex_count);
  pags_proxy_mesh_normals(surface, normals);
  PAGS_TRY(thin(surface->positions, surface->vertex_count, step, &kept, &count));
  for (int64_t i = 0; i < count; i++) {
    double n[3];
    pags_widen3(normals + 3 * kept[i], n);
    PAGS_TRY(add_point(surface->positions + 3 * kept[i], n, out));
  }
  return PAGS_OK;
}
