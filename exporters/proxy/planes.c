/* SPDX-License-Identifier: Apache-2.0 */
/* Finds upright planes one by one, the largest first: RANSAC on points with normals, with candidates refined from a
 * neighbourhood that grows (Schnabel, Wahl and Klein 2007, "Efficient RANSAC for point-cloud shape detection"). */
#include "exporters/proxy/planes.h"

#include <math.h>

#include "base/rng.h"
#include "base/vec3.h"
#include "exporters/proxy/depth_view.h"
#include "maths/maths.h"

enum { SAMPLES = 8192, CANDIDATES = 32, LEAST_SAMPLES = 6, SEED = 62 };

static const double band = 0.15; /* points at most this far from a plane, in metres, support it, */
static const double alike = 0.7; /* if their normals have at least this cosine to its */

typedef struct search {
  const pags_surface_points *points;
  int64_t round, count; /* count: of the samples, evenly chosen among the points */
  pags_surface_plane planes[CANDIDATES];
  int64_t support[CANDIDATES]; /* number of samples */
} search;

static int64_t sample_point(const search *s, int64_t sample) {
  return sample * s->points->count / s->count;
}

/* Fits an upright plane to the samples that support it within `reach` metres of `middle`: the line of least squares
 * seen from above. Returns how many do. */
static int64_t refit(const search *s, const double middle[3], double reach, pags_surface_plane *plane) {
  double p[3], n[3], x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  int64_t count = 0;
  for (int64_t i = 0; i < s->count; i++) {
    const int64_t at = sample_point(s, i);
    pags_widen3(s->points->positions + 3 * at, p);
    pags_widen3(s->points->normals + 3 * at, n);
    if (!(fabs(pags_dot3(plane->normal, p) - plane->offset) < band) || !(pags_dot3(plane->normal, n) > alike) ||
        !(pags_distance_squared3(p, middle) < reach * reach))
      continue;
    const double dx = p[0] - middle[0], dy = p[1] - middle[1];
    x += dx;
    y += dy;
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    count++;
  }
  if (count < LEAST_SAMPLES)
    return count;
  xx -= x * x / (double)count;
  xy -= x * y / (double)count;
  yy -= y * y / (double)count;
  const double angle = 0.5 * pags_atan2(2 * xy, xx - yy); /* of the line */
  double normal[3] = {-pags_sin(angle), pags_cos(angle), 0};
  if (pags_dot3(normal, plane->normal) < 0)
    pags_scale3(-1, normal, normal);
  if (!(pags_dot3(normal, plane->normal) > alike)) /* the points are higher than wide */
    return count;
  pags_copy3(normal, plane->normal);
  plane->offset = normal[0] * (middle[0] + x / (double)count) + normal[1] * (middle[1] + y / (double)count);
  return count;
}

static void try_candidates(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  static const double reaches[] = {1.5, 3, 7, 7};
  search *s = context;
  for (int64_t c = begin; c < end; c++) {
    const uint64_t sample = pags_rng_below(SEED, (uint64_t)s->round, (uint64_t)c, (uint64_t)s->count);
    const int64_t at = sample_point(s, (int64_t)sample);
    double p[3];
    pags_surface_plane *plane = &s->planes[c];
    pags_widen3(s->points->positions + 3 * at, p);
    pags_copy3(p, plane->middle);
    pags_widen3(s->points->normals + 3 * at, plane->normal);
    plane->normal[2] = 0;
    s->support[c] = 0;
    if (!(pags_length3(plane->normal) > 0.5))
      continue;
    pags_divide3(plane->normal, pags_length3(plane->normal));
    plane->offset = pags_dot3(plane->normal, p);
    for (size_t i = 0; i < sizeof reaches / sizeof reaches[0]; i++)
      s->support[c] = refit(s, p, reaches[i], plane);
  }
}

pags_result pags_surface_plane_find(const pags_surface_points *points, int64_t round, pags_tasks *tasks,
                                    pags_surface_plane *out, double *area) {
  search s = {.points = points, .round = round, .count = points->count < SAMPLES ? points->count : SAMPLES};
  int64_t best = 0;
  *area = 0;
  if (!s.count)
    return PAGS_OK;
  PAGS_TRY(pags_proxy_for(tasks, CANDIDATES, 1, try_candidates, &s));
  for (int64_t c = 1; c < CANDIDATES; c++)
    best = s.support[c] > s.support[best] ? c : best;
  *out = s.planes[best];
  *area = (double)s.support[best] * points->area * (double)points->count / (double)s.count;
  return PAGS_OK;
}
