/* SPDX-License-Identifier: Apache-2.0 */
/* Measures the distances between a proxy and the Gaussians' surface as seen by the training cameras, and the overlap
 * of their silhouettes.
 *
 * Each view is sampled on a lattice of at most SIDE x SIDE pixels. A sample gives a point of the Gaussians' surface,
 * from the pixel's depth, and a point of the proxy, where the pixel's ray first hits the proxy. Distances are
 * measured from the former points to the nearest triangle of the proxy, and from the latter points to the nearest of
 * the former. */
#include "exporters/proxy/proxy_error.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/mesh_query.h"

enum { SIDE = 48 };

pags_proxy_distance pags_distance_summary(double *values, int64_t count) {
  pags_proxy_distance out = {(double)NAN, (double)NAN, (double)NAN};
  double sum = 0;
  if (!count)
    return out;
  pags_sort_doubles(values, count);
  for (int64_t i = 0; i < count; i++)
    sum += values[i];
  out.mean = sum / (double)count;
  out.p95 = values[(int64_t)ceil(0.95 * (double)count) - 1];
  out.max = values[count - 1];
  return out;
}

typedef struct sample {
  float seen[3], met[3];                /* point of the Gaussians' surface; point where the ray hits the proxy */
  uint32_t triangle_met, triangle_near; /* triangles of the proxy: hit by the ray; nearest to `seen` */
  uint8_t has_seen, has_met, covered;   /* whether `seen` is set, `met` is set, the pixel's alpha is at least 1/2 */
} sample;

typedef struct comparison {
  const pags_depth_views *depth_views;
  const pags_mesh_query *query, *cloud; /* over the proxy's triangles; over the points of the Gaussians' surface */
  sample *samples;                      /* SIDE * SIDE for each view */

  const int32_t *group_of; /* the group of each of the proxy's triangles; NULL: there is one group */
  int64_t group_count;
  double range;      /* depths beyond it, in metres, are left out */
  double *to, *from; /* each sample's distance from `met` to the Gaussians, from `seen` to the proxy; -1: none */
} comparison;

/* ---- Sampling the views ---- */

static void take_sample(const comparison *self, const pags_depth_view *depth_view, int x, int y, sample *out) {
  int64_t pixel = (int64_t)y * depth_view->camera.width + x;
  const double *m = depth_view->camera.world_from_camera;
  const double origin[3] = {m[3], m[7], m[11]};
  double direction[3], point[3], depth = (double)depth_view->depth[pixel];
  *out = (sample){0};
  pags_depth_view_point(depth_view, x, y, 1, direction);
  for (int k = 0; k < 3; k++)
    direction[k] -= origin[k];
  double t = pags_mesh_query_ray(self->query, origin, direction, &out->triangle_met);
  /* A negative depth is how far the ray is free: beyond, the rest of the scene hides it. If the Gaussians' cover or
   * the proxy's hit lies in the hidden part, nothing is known of this pixel. */
  if (depth < 0 && (depth_view->cover[pixel] >= 128 || t > -depth))
    return;
  out->covered = depth_view->cover[pixel] >= 128;
  out->has_met = t > 0;
  out->has_seen = depth > 0 && depth < self->range;
  for (int k = 0; k < 3 && t > 0; k++)
    out->met[k] = (float)(origin[k] + t * direction[k]);
  if (depth > 0) {
    pags_depth_view_point(depth_view, x, y, depth, point);
    for (int k = 0; k < 3; k++)
      out->seen[k] = (float)point[k];
  }
}

static void sample_views(void *context, int64_t begin, int64_t end, int worker) {
  comparison *self = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    const pags_depth_view *depth_view = &self->depth_views->list[i];
    int w = depth_view->camera.width, h = depth_view->camera.height, nx = w < SIDE ? w : SIDE, ny = h < SIDE ? h : SIDE;
    sample *out = self->samples + i * SIDE * SIDE;
    memset(out, 0, SIDE * SIDE * sizeof *out);
    for (int y = 0; y < ny; y++)
      for (int x = 0; x < nx; x++)
        take_sample(self, depth_view, (2 * x + 1) * w / (2 * nx), (2 * y + 1) * h / (2 * ny), &out[y * SIDE + x]);
  }
}

/* ---- Distances ---- */

static void measure_samples(void *context, int64_t begin, int64_t end, int worker) {
  comparison *self = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    sample *s = &self->samples[i];
    self->to[i] = self->from[i] = -1;
    if (s->has_seen) {
      const double p[3] = {(double)s->seen[0], (double)s->seen[1], (double)s->seen[2]};
      self->from[i] = pags_mesh_query_distance(self->query, p, &s->triangle_near);
    }
    if (s->has_met && s->has_seen) {
      const double p[3] = {(double)s->met[0], (double)s->met[1], (double)s->met[2]};
      self->to[i] = pags_mesh_query_distance(self->cloud, p, NULL);
    }
  }
}

/* Summarises the distances of the samples of one group, or of all samples if `group_of` is NULL. `near`: a sample's
 * group is that of its nearest triangle, else that of the triangle hit. `kept` is room for `count` values. */
static pags_proxy_distance summarise(const comparison *self, const double *values, int64_t count, int near,
                                     int64_t group, double *kept) {
  int64_t n = 0;
  for (int64_t i = 0; i < count; i++) {
    const sample *s = &self->samples[i];
    if (values[i] >= 0 && isfinite(values[i]) &&
        (!self->group_of || self->group_of[near ? s->triangle_near : s->triangle_met] == group))
      kept[n++] = values[i];
  }
  return pags_distance_summary(kept, n);
}

static pags_result measure(comparison *self, int64_t count, pags_tasks *tasks, pags_proxy_facts *facts) {
  float *points = malloc(((size_t)count + 1) * 3 * sizeof *points);
  double *kept = malloc(((size_t)count + 1) * sizeof *kept);
  pags_mesh_query *cloud = NULL;
  int64_t found = 0;
  if (!points || !kept) {
    free(points);
    free(kept);
    return pags_out_of_memory("%lld samples", (long long)count);
  }
  for (int64_t i = 0; i < count; i++)
    if (self->samples[i].has_seen)
      memcpy(points + 3 * found++, self->samples[i].seen, 3 * sizeof *points);
  pags_result result = found ? pags_mesh_query_of_points(points, found, &cloud) : PAGS_OK;
  if (result == PAGS_OK && found) {
    self->cloud = cloud;
    if (!pags_parallel_for(tasks, count, 1024, measure_samples, self))
      result = pags_fail(PAGS_CANCELLED, "interrupted");
    else {
      for (int64_t g = 0; g < self->group_count; g++) {
        facts[g].to_gaussians = summarise(self, self->to, count, 0, g, kept);
        facts[g].from_gaussians = summarise(self, self->from, count, 1, g, kept);
      }
    }
  }
  pags_mesh_query_destroy(cloud);
  free(points);
  free(kept);
  return result;
}

static pags_result compare(comparison *self, int64_t count, pags_tasks *tasks, pags_proxy_facts *facts) {
  if (!pags_parallel_for(tasks, self->depth_views->count, 1, sample_views, self))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  if (!self->group_of) {
    /* The silhouettes' intersection over union, over the samples of all views together. */
    int64_t both = 0, either = 0;
    for (int64_t i = 0; i < count; i++) {
      both += self->samples[i].covered && self->samples[i].has_met;
      either += self->samples[i].covered || self->samples[i].has_met;
    }
    facts->silhouette_iou = either ? (double)both / (double)either : (double)NAN;
  }
  return measure(self, count, tasks, facts);
}

/* ---- The measures ---- */

double pags_proxy_mesh_observed(const pags_proxy_mesh *surface) {
  double seen = 0, all = 0;
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    const uint32_t *t = surface->triangles + 3 * i;
    const float *a = surface->positions + 3 * (int64_t)t[0], *b = surface->positions + 3 * (int64_t)t[1],
                *c = surface->positions + 3 * (int64_t)t[2];
    double u[3], v[3], square = 0;
    for (int k = 0; k < 3; k++) {
      u[k] = (double)b[k] - (double)a[k];
      v[k] = (double)c[k] - (double)a[k];
    }
    for (int k = 0; k < 3; k++) {
      double n = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
      square += n * n;
    }
    all += sqrt(square);
    seen += sqrt(square) * (surface->observed[t[0]] + surface->observed[t[1]] + surface->observed[t[2]]) / 3;
  }
  return all > 0 ? seen / all : 0;
}

static pags_result run(const pags_proxy_mesh *proxy, comparison *self, pags_tasks *tasks, pags_proxy_facts *facts) {
  int64_t count = self->depth_views->count * SIDE * SIDE;
  pags_mesh_query *query = NULL;
  for (int64_t g = 0; g < self->group_count; g++) {
    const pags_proxy_distance nothing = {(double)NAN, (double)NAN, (double)NAN};
    facts[g].to_gaussians = facts[g].from_gaussians = nothing;
    facts[g].silhouette_iou = (double)NAN;
    facts[g].silhouette_views = (int)self->depth_views->count;
  }
  if (!self->depth_views->count || !proxy->triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_mesh_query_of_mesh(proxy, &query));
  self->query = query;
  self->samples = malloc((size_t)count * sizeof *self->samples);
  self->to = malloc((size_t)count * sizeof *self->to);
  self->from = malloc((size_t)count * sizeof *self->from);
  pags_result result = self->samples && self->to && self->from ? compare(self, count, tasks, facts)
                                                               : pags_out_of_memory("%lld samples", (long long)count);
  free(self->samples);
  free(self->to);
  free(self->from);
  pags_mesh_query_destroy(query);
  return result;
}

pags_result pags_proxy_compare(const pags_proxy_mesh *proxy, const pags_depth_views *depth_views, pags_tasks *tasks,
                               pags_proxy_facts *facts) {
  comparison self = {.depth_views = depth_views, .range = HUGE_VAL, .group_count = 1};
  facts->observed = pags_proxy_mesh_observed(proxy);
  return run(proxy, &self, tasks, facts);
}

pags_result pags_proxies_compare(const pags_proxy_mesh *proxies, const int32_t *group_of, int64_t group_count,
                                 const pags_depth_views *depth_views, double range, pags_tasks *tasks,
                                 pags_proxy_facts *facts) {
  comparison self = {.depth_views = depth_views, .range = range, .group_of = group_of, .group_count = group_count};
  return run(proxies, &self, tasks, facts);
}
