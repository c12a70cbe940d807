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

static const pags_proxy_distance nothing = {(double)NAN, (double)NAN, (double)NAN};

pags_proxy_distance pags_distance_summary(double *values, int64_t count) {
  double sum = 0;
  if (!count)
    return nothing;
  pags_sort_doubles(values, count);
  for (int64_t i = 0; i < count; i++)
    sum += values[i];
  return (pags_proxy_distance){
      .mean = sum / (double)count, .p95 = values[(int64_t)ceil(0.95 * (double)count) - 1], .max = values[count - 1]};
}

typedef struct sample {
  float seen[3], met[3];                /* point of the Gaussians' surface; point where the ray hits the proxy */
  uint32_t triangle_met, triangle_near; /* triangles of the proxy: hit by the ray; nearest to `seen` */
  bool has_seen, has_met, covered;      /* whether `seen` is set, `met` is set, the pixel's alpha is at least 1/2 */
} sample;

typedef struct comparison {
  const pags_depth_views *depth_views;
  pags_mesh_query *query, *cloud; /* over the proxy's triangles; over the points of the Gaussians' surface */
  sample *samples;                /* SIDE * SIDE for each view */

  const int32_t *group_of; /* the group of each of the proxy's triangles; NULL: there is one group */
  int64_t group_count;
  double range;      /* depths beyond it, in metres, are left out */
  double *to, *from; /* each sample's distance from `met` to the Gaussians, from `seen` to the proxy; -1: none */
} comparison;

static void forget_comparison(comparison *c) {
  pags_mesh_query_destroy(c->query);
  pags_mesh_query_destroy(c->cloud);
  free(c->samples);
  free(c->to);
  free(c->from);
}

/* ---- Sampling the views ---- */

static void take_sample(const comparison *c, const pags_depth_view *depth_view, int x, int y, sample *out) {
  int64_t pixel = (int64_t)y * depth_view->camera.width + x;
  double origin[3], direction[3], point[3], depth = (double)depth_view->depth[pixel];
  const bool covered = depth_view->cover[pixel] >= 128;
  *out = (sample){0};
  pags_pose_position(depth_view->camera.world_from_camera, origin);
  pags_depth_view_point(depth_view, x, y, 1, direction);
  pags_subtract3(direction, origin, direction);
  double t = pags_mesh_query_ray(c->query, origin, direction, &out->triangle_met);
  /* A negative depth is how far the ray is free: beyond, the rest of the scene hides it. If the Gaussians' cover or
   * the proxy's hit lies in the hidden part, nothing is known of this pixel. */
  if (depth < 0 && (covered || t > -depth))
    return;
  out->covered = covered;
  out->has_met = t > 0;
  out->has_seen = depth > 0 && depth < c->range;
  if (t > 0) {
    pags_along3(origin, t, direction, point);
    pags_narrow3(point, out->met);
  }
  if (depth > 0) {
    pags_depth_view_point(depth_view, x, y, depth, point);
    pags_narrow3(point, out->seen);
  }
}

static void sample_views(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  comparison *c = context;
  for (int64_t i = begin; i < end; i++) {
    const pags_depth_view *depth_view = &c->depth_views->list[i];
    int w = depth_view->camera.width, h = depth_view->camera.height, nx = w < SIDE ? w : SIDE, ny = h < SIDE ? h : SIDE;
    sample *out = c->samples + i * SIDE * SIDE;
    memset(out, 0, SIDE * SIDE * sizeof *out);
    for (int y = 0; y < ny; y++)
      for (int x = 0; x < nx; x++)
        take_sample(c, depth_view, (2 * x + 1) * w / (2 * nx), (2 * y + 1) * h / (2 * ny), &out[y * SIDE + x]);
  }
}

/* ---- Distances ---- */

static void measure_samples(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  comparison *c = context;
  for (int64_t i = begin; i < end; i++) {
    sample *s = &c->samples[i];
    double p[3];
    c->to[i] = c->from[i] = -1;
    if (!s->has_seen)
      continue;
    pags_widen3(s->seen, p);
    c->from[i] = pags_mesh_query_distance(c->query, p, &s->triangle_near);
    pags_widen3(s->met, p);
    if (s->has_met)
      c->to[i] = pags_mesh_query_distance(c->cloud, p, NULL);
  }
}

/* Summarises the distances of the samples of one group, or of all samples if `group_of` is NULL. `near`: a sample's
 * group is that of its nearest triangle, else that of the triangle hit. `kept` is room for `count` values. */
static pags_proxy_distance summarise(const comparison *c, const double *values, int64_t count, bool near, int64_t group,
                                     double *kept) {
  int64_t n = 0;
  for (int64_t i = 0; i < count; i++) {
    const sample *s = &c->samples[i];
    if (values[i] >= 0 && isfinite(values[i]) &&
        (!c->group_of || c->group_of[near ? s->triangle_near : s->triangle_met] == group))
      kept[n++] = values[i];
  }
  return pags_distance_summary(kept, n);
}

/* ---- The measures ---- */

double pags_proxy_mesh_observed(const pags_proxy_mesh *surface) {
  double seen = 0, all = 0, n[3];
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    const uint32_t *t = surface->triangles + 3 * i;
    pags_proxy_mesh_cross(surface, i, n);
    const double area = pags_length3(n);
    all += area;
    seen += area * (surface->observed[t[0]] + surface->observed[t[1]] + surface->observed[t[2]]) / 3;
  }
  return all > 0 ? seen / all : 0;
}

/* Fills in the facts of each group; takes over what `c` owns. */
static pags_result compare(const pags_proxy_mesh *proxy, comparison begun, pags_tasks *tasks, pags_proxy_facts *facts) {
  PAGS_AUTO(forget_comparison) comparison c = begun;
  const int64_t count = c.depth_views->count * SIDE * SIDE;
  for (int64_t g = 0; g < c.group_count; g++) {
    facts[g].to_gaussians = facts[g].from_gaussians = nothing;
    facts[g].silhouette_iou = (double)NAN;
    facts[g].silhouette_views = (int)c.depth_views->count;
  }
  if (!c.depth_views->count || !proxy->triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_mesh_query_of_mesh(proxy, &c.query));
  c.samples = malloc((size_t)count * sizeof *c.samples);
  c.to = malloc((size_t)count * sizeof *c.to);
  c.from = malloc((size_t)count * sizeof *c.from);
  PAGS_CHECK_MEMORY(c.samples && c.to && c.from, "%lld samples", (long long)count);
  PAGS_TRY(pags_proxy_for(tasks, c.depth_views->count, 1, sample_views, &c));
  if (!c.group_of) {
    /* The silhouettes' intersection over union, over the samples of all views together. */
    int64_t both = 0, either = 0;
    for (int64_t i = 0; i < count; i++) {
      both += c.samples[i].covered && c.samples[i].has_met;
      either += c.samples[i].covered || c.samples[i].has_met;
    }
    facts->silhouette_iou = either ? (double)both / (double)either : (double)NAN;
  }

  /* The distances, to the nearest triangle of the proxy and to the nearest point of the Gaussians' surface. */
  PAGS_AUTOFREE float *points = malloc(((size_t)count + 1) * 3 * sizeof *points);
  PAGS_AUTOFREE double *kept = malloc(((size_t)count + 1) * sizeof *kept);
  int64_t found = 0;
  PAGS_CHECK_MEMORY(points && kept, "%lld samples", (long long)count);
  for (int64_t i = 0; i < count; i++)
    if (c.samples[i].has_seen)
      pags_copy3f(c.samples[i].seen, points + 3 * found++);
  if (!found)
    return PAGS_OK;
  PAGS_TRY(pags_mesh_query_of_points(points, found, &c.cloud));
  PAGS_TRY(pags_proxy_for(tasks, count, 1024, measure_samples, &c));
  for (int64_t g = 0; g < c.group_count; g++) {
    facts[g].to_gaussians = summarise(&c, c.to, count, false, g, kept);
    facts[g].from_gaussians = summarise(&c, c.from, count, true, g, kept);
  }
  return PAGS_OK;
}

pags_result pags_proxy_compare(const pags_proxy_mesh *proxy, const pags_depth_views *depth_views, pags_tasks *tasks,
                               pags_proxy_facts *facts) {
  facts->observed = pags_proxy_mesh_observed(proxy);
  return compare(proxy, (comparison){.depth_views = depth_views, .range = HUGE_VAL, .group_count = 1}, tasks, facts);
}

pags_result pags_proxies_compare(const pags_proxy_mesh *proxies, const int32_t *group_of, int64_t group_count,
                                 const pags_depth_views *depth_views, double range, pags_tasks *tasks,
                                 pags_proxy_facts *facts) {
  const comparison c = {.depth_views = depth_views, .range = range, .group_of = group_of, .group_count = group_count};
  return compare(proxies, c, tasks, facts);
}
