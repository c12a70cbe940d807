/* SPDX-License-Identifier: Apache-2.0 */
/* Fuses depth views into a truncated signed distance field (TSDF), a weighted mean per grid point (Curless and Levoy
 * 1996), block by block in parallel. Also paints meshes with the colours of the views. */
#include "exporters/proxy/tsdf.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"

static const int64_t most_points = (int64_t)1 << 28;

/* ---- The grid ---- */

pags_result pags_tsdf_create(pags_tsdf *grid, const double lo[3], const double hi[3], double step, bool sparse) {
  int64_t points = 1, blocks = 1;
  *grid = (pags_tsdf){.step = step};
  for (int k = 0; k < 3; k++) {
    double n = ceil((hi[k] - lo[k]) / step) + 1;
    if (!(n >= 2 && n < 1 << 20) || (points *= (int64_t)n) > most_points)
      return pags_fail(PAGS_ERROR_LIMIT, "a grid of %g m over %g x %g x %g m has too many points", step, hi[0] - lo[0],
                       hi[1] - lo[1], hi[2] - lo[2]);
    grid->n[k] = (int)n;
    grid->origin[k] = lo[k];
    grid->blocks[k] = (grid->n[k] + PAGS_GRID_BLOCK - 1) / PAGS_GRID_BLOCK;
    blocks *= grid->blocks[k];
  }
  grid->distance = calloc((size_t)points, sizeof(float));
  grid->weight = calloc((size_t)points, sizeof(float));
  if (sparse)
    grid->active = calloc((size_t)blocks, 1);
  PAGS_CHECK_MEMORY(grid->distance && grid->weight && (!sparse || grid->active), "a grid of %lld points",
                    (long long)points);
  return PAGS_OK;
}

void pags_tsdf_destroy(pags_tsdf *grid) {
  free(grid->distance);
  free(grid->weight);
  free(grid->active);
  memset(grid, 0, sizeof *grid);
}

void pags_tsdf_touch(pags_tsdf *grid, const double point[3], double reach) {
  int from[3], to[3];
  double side = PAGS_GRID_BLOCK * grid->step;
  for (int k = 0; k < 3; k++) {
    double low = floor((point[k] - reach - grid->origin[k]) / side),
           high = floor((point[k] + reach - grid->origin[k]) / side);
    if (!(high >= 0 && low < grid->blocks[k]))
      return;
    from[k] = low < 0 ? 0 : (int)low;
    to[k] = high >= grid->blocks[k] ? grid->blocks[k] - 1 : (int)high;
  }
  for (int z = from[2]; z <= to[2]; z++)
    for (int y = from[1]; y <= to[1]; y++)
      memset(grid->active + ((int64_t)z * grid->blocks[1] + y) * grid->blocks[0] + from[0], 1,
             (size_t)(to[0] - from[0] + 1));
}

void pags_tsdf_close_border(pags_tsdf *grid, float distance) {
  for (int64_t i = 0; i < (int64_t)grid->n[0] * grid->n[1] * grid->n[2]; i++) {
    int64_t x = i % grid->n[0], y = i / grid->n[0] % grid->n[1], z = i / grid->n[0] / grid->n[1];
    if (x == 0 || y == 0 || z == 0 || x + 1 == grid->n[0] || y + 1 == grid->n[1] || z + 1 == grid->n[2])
      grid->distance[i] = distance;
  }
}

/* ---- Fusion ---- */

typedef struct fusion {
  pags_tsdf *grid;
  const pags_depth_views *depth_views;
  double truncation, behind, range;
  bool carve;
  int64_t *lists; /* of views, one for each worker */
} fusion;

/* The weight of a view at camera z: the squared size in pixels of a grid step, at most 1, since the variance of depth
 * goes with the inverse square. */
static double weigh(const pags_depth_view *depth_view, double step, double z) {
  double pixels = depth_view->camera.fx * step / z;
  return fmin(1, pixels * pixels) + 1e-3;
}

/* The truncated signed distance that one view gives for one point. Returns the weight; 0: the view says nothing. */
static double ask(const fusion *f, const pags_depth_view *depth_view, const double point[3], double *distance) {
  int x, y;
  double z;
  if (!pags_depth_view_project(depth_view, point, &x, &y, &z) || z > f->range)
    return 0;
  double depth = (double)depth_view->depth[(int64_t)y * depth_view->camera.width + x];
  if (depth == 0 || (depth < 0 && (!f->carve || z > -depth)))
    return 0;
  *distance = depth < 0 ? f->truncation : depth - z;
  if (*distance < -f->behind)
    return 0;
  *distance = fmin(*distance, f->truncation);
  return weigh(depth_view, f->grid->step, z);
}

/* Sums over the views that say of a whole block that it is free. */
typedef struct known {
  double sum, weight;
} known;

/* Sorts the views by what they say of the ball around a block: nothing, that all of it is free (`sure`), or something
 * that must be asked point by point (`seen`). Returns the number of the latter. */
static int64_t choose_views(const fusion *f, const double middle[3], double radius, int64_t *seen, known *sure) {
  int64_t count = 0;
  *sure = (known){0};
  for (int64_t i = 0; i < f->depth_views->count; i++) {
    const pags_depth_view *depth_view = &f->depth_views->list[i];
    double z;
    if (!pags_depth_view_may_see(depth_view, middle, radius, f->range))
      continue;
    pags_depth_view_verdict verdict = pags_depth_view_classify(depth_view, middle, radius, f->truncation, &z);
    if (verdict == PAGS_DEPTH_VIEW_CLEAR && f->carve && z + radius <= f->range) {
      double w = weigh(depth_view, f->grid->step, z);
      sure->sum += w * f->truncation;
      sure->weight += w;
    } else if (verdict != PAGS_DEPTH_VIEW_HIDDEN) {
      seen[count++] = i;
    }
  }
  return count;
}

static void fuse_block(const fusion *f, int64_t block, int64_t *seen) {
  const pags_tsdf *grid = f->grid;
  int first[3] = {(int)(block % grid->blocks[0]) * PAGS_GRID_BLOCK,
                  (int)(block / grid->blocks[0] % grid->blocks[1]) * PAGS_GRID_BLOCK,
                  (int)(block / grid->blocks[0] / grid->blocks[1]) * PAGS_GRID_BLOCK};
  int last[3];
  double middle[3], half = 0.5 * (PAGS_GRID_BLOCK - 1) * grid->step;
  known sure;
  for (int k = 0; k < 3; k++) {
    last[k] = first[k] + PAGS_GRID_BLOCK < grid->n[k] ? first[k] + PAGS_GRID_BLOCK : grid->n[k];
    middle[k] = grid->origin[k] + first[k] * grid->step + half;
  }
  int64_t seen_count = choose_views(f, middle, 1.7321 * half, seen, &sure);
  for (int z = first[2]; z < last[2]; z++)
    for (int y = first[1]; y < last[1]; y++)
      for (int x = first[0]; x < last[0]; x++) {
        const double point[3] = {grid->origin[0] + x * grid->step, grid->origin[1] + y * grid->step,
                                 grid->origin[2] + z * grid->step};

        /* The weighted mean of the views that are sure of the whole block and of those asked for this point. */
        int64_t at = ((int64_t)z * grid->n[1] + y) * grid->n[0] + x;
        double sum = sure.sum, weight = sure.weight, distance = 0;
        for (int64_t i = 0; i < seen_count; i++) {
          double w = ask(f, &f->depth_views->list[seen[i]], point, &distance);
          if (w > 0) {
            sum += w * distance;
            weight += w;
          }
        }
        if (weight > 0) {
          f->grid->distance[at] = (float)(sum / weight);
          f->grid->weight[at] = (float)weight;
        }
      }
}

static void fuse_blocks(void *context, int64_t begin, int64_t end, int worker) {
  const fusion *f = context;
  for (int64_t block = begin; block < end; block++)
    if (!f->grid->active || f->grid->active[block])
      fuse_block(f, block, f->lists + worker * (f->depth_views->count + 1));
}

pags_result pags_tsdf_fuse(pags_tsdf *grid, const pags_depth_views *depth_views, double truncation, double behind,
                           double range, bool carve, pags_tasks *tasks) {
  PAGS_AUTOFREE int64_t *lists = NULL;
  PAGS_TRY(pags_depth_views_lists(depth_views, tasks, &lists));
  fusion f = {grid, depth_views, truncation, behind, range, carve, lists};
  return pags_proxy_for(tasks, (int64_t)grid->blocks[0] * grid->blocks[1] * grid->blocks[2], 16, fuse_blocks, &f);
}

/* ---- Colours ---- */

pags_result pags_depth_views_lists(const pags_depth_views *depth_views, const pags_tasks *tasks, int64_t **out) {
  const size_t count = (size_t)pags_tasks_workers(tasks) * ((size_t)depth_views->count + 1);
  *out = malloc(count * sizeof **out);
  PAGS_CHECK_MEMORY(*out, "lists of %lld views", (long long)depth_views->count);
  return PAGS_OK;
}

int64_t pags_depth_views_of_run(const pags_depth_views *depth_views, const pags_proxy_mesh *mesh, int64_t begin,
                                int64_t end, int64_t *seen) {
  const pags_proxy_mesh run = {.positions = mesh->positions + 3 * begin, .vertex_count = end - begin};
  double lo[3], hi[3], middle[3], radius = 0;
  int64_t count = 0;
  pags_proxy_mesh_bounds(&run, lo, hi);
  for (int k = 0; k < 3; k++) {
    middle[k] = 0.5 * (lo[k] + hi[k]);
    radius += 0.25 * (hi[k] - lo[k]) * (hi[k] - lo[k]);
  }
  for (int64_t s = 0; s < depth_views->count; s++)
    if (pags_depth_view_may_see(&depth_views->list[s], middle, sqrt(radius), HUGE_VAL))
      seen[count++] = s;
  return count;
}

typedef struct painting {
  pags_proxy_mesh *surface;
  const pags_depth_views *depth_views;
  double tolerance;
  float *density; /* or NULL */
  int64_t *lists; /* of views, one for each worker */
} painting;

static void paint_vertices(void *context, int64_t begin, int64_t end, int worker) {
  const painting *p = context;
  int64_t *seen = p->lists + worker * (p->depth_views->count + 1);
  int64_t seen_count = pags_depth_views_of_run(p->depth_views, p->surface, begin, end, seen);
  for (int64_t i = begin; i < end; i++) {
    double point[3], sum[3] = {0}, weight = 0, density = 0, z;
    int x, y;
    pags_proxy_mesh_point(p->surface, i, point);
    for (int64_t s = 0; s < seen_count; s++) {
      const pags_depth_view *depth_view = &p->depth_views->list[seen[s]];
      if (!pags_depth_view_project(depth_view, point, &x, &y, &z))
        continue;
      int64_t pixel = (int64_t)y * depth_view->camera.width + x;
      double depth = (double)depth_view->depth[pixel];
      if (depth <= 0 || fabs(depth - z) > p->tolerance)
        continue;
      double w = 1 / (z * z);
      for (int c = 0; c < 3; c++)
        sum[c] += w * depth_view->rgb[3 * pixel + c] / 255.0;
      weight += w;
      density = fmax(density, depth_view->camera.fx / z);
    }
    if (p->density)
      p->density[i] = (float)density;
    for (int c = 0; c < 3; c++)
      p->surface->colors[3 * i + c] = weight > 0 ? (float)(sum[c] / weight) : -1.0f;
  }
}

pags_result pags_proxy_mesh_paint_seen(pags_proxy_mesh *surface, const pags_depth_views *depth_views, double tolerance,
                                       float *density, pags_tasks *tasks) {
  PAGS_AUTOFREE int64_t *lists = NULL;
  PAGS_TRY(pags_depth_views_lists(depth_views, tasks, &lists));
  painting p = {surface, depth_views, tolerance, density, lists};
  return pags_proxy_for(tasks, surface->vertex_count, 256, paint_vertices, &p);
}

pags_result pags_proxy_mesh_paint(pags_proxy_mesh *surface, const pags_depth_views *depth_views, double tolerance,
                                  pags_tasks *tasks) {
  double mean[3] = {0}, count = 0;
  PAGS_TRY(pags_proxy_mesh_paint_seen(surface, depth_views, tolerance, NULL, tasks));
  for (int64_t i = 0; i < surface->vertex_count; i++)
    if (surface->colors[3 * i] >= 0) {
      for (int c = 0; c < 3; c++)
        mean[c] += (double)surface->colors[3 * i + c];
      count++;
    }
  for (int64_t i = 0; i < surface->vertex_count; i++) {
    float *color = surface->colors + 3 * i;
    if (color[0] < 0)
      for (int c = 0; c < 3; c++)
        color[c] = count > 0 ? (float)(mean[c] / count) : 0.5f;
  }
  return PAGS_OK;
}
