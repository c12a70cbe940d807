/* SPDX-License-Identifier: Apache-2.0 */
/* Convex hulls of meshes with a limit of triangles, by qhull (Barber, Dobkin and Huhdanpaa 1996). */
#include <libqhull_r/qhull_ra.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/mesh.h"

#include "base/memory.h"
#include "maths/maths.h"

/* Chooses the vertices that lie farthest in `count` evenly spread directions (a spherical Fibonacci lattice for the
 * mesh scaled to a cube). The hull of at most `count` vertices has at most 2 count - 4 triangles. Writes the chosen
 * vertices once each, in ascending order, and returns how many; -1 when out of memory. */
static int64_t farthest(const pags_proxy_mesh *s, int64_t count, int64_t *chosen) {
  double lo[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  for (int64_t i = 0; i < 3 * s->vertex_count; i++) {
    lo[i % 3] = fmin(lo[i % 3], (double)s->positions[i]);
    hi[i % 3] = fmax(hi[i % 3], (double)s->positions[i]);
  }
  uint8_t *taken = calloc((size_t)s->vertex_count + 1, 1);
  int64_t found = 0;
  if (!taken)
    return -1;
  for (int64_t d = 0; d < count; d++) {
    double z = 1 - (2 * (double)d + 1) / (double)count, r = sqrt(1 - z * z), angle = 2.39996322972865332 * (double)d;
    const double direction[3] = {r * pags_cos(angle) / (hi[0] - lo[0] + 1e-9),
                                 r * pags_sin(angle) / (hi[1] - lo[1] + 1e-9), z / (hi[2] - lo[2] + 1e-9)};
    double best = -HUGE_VAL;
    int64_t at = 0;
    for (int64_t i = 0; i < s->vertex_count; i++) {
      const float *p = s->positions + 3 * i;
      double along = direction[0] * (double)p[0] + direction[1] * (double)p[1] + direction[2] * (double)p[2];
      if (along > best) {
        best = along;
        at = i;
      }
    }
    taken[at] = 1;
  }
  for (int64_t i = 0; i < s->vertex_count; i++)
    if (taken[i])
      chosen[found++] = i;
  free(taken);
  return found;
}

/* Copies qhull's facets (qhull's option `Qt` made them triangles) and their vertices into `out`. */
static void read_facets(qhT *qh, const pags_proxy_mesh *from, const int64_t *chosen, uint32_t *place,
                        pags_proxy_mesh *out) {
  facetT *facet;
  vertexT *vertex, **vertexp;
  FORALLfacets {
    uint32_t corners[3] = {0};
    int n = 0;
    setT *vertices = qh_facet3vertex(qh, facet); /* clockwise seen from outside */
    FOREACHvertex_(vertices) {
      int point = qh_pointid(qh, vertex->point);
      if (place[point] == UINT32_MAX)
        place[point] = pags_proxy_mesh_vertex(out, from->positions + 3 * chosen[point],
                                              from->colors + 3 * chosen[point], from->observed[chosen[point]]);
      if (n < 3)
        corners[n++] = place[point];
    }
    qh_settempfree(qh, &vertices);
    pags_proxy_mesh_triangle(out, corners[0], corners[2], corners[1]);
  }
}

static pags_result run_qhull(const pags_proxy_mesh *from, const int64_t *chosen, int64_t count, double *points,
                             uint32_t *place, pags_proxy_mesh *out) {
  char options[] = "qhull Qt", said[256] = "";
  FILE *errors = tmpfile();
  PAGS_CHECK_MEMORY(errors, "a convex hull");
  qhT qh;
  int left, total;
  qh_zero(&qh, errors);
  int code = qh_new_qhull(&qh, 3, (int)count, points, False, options, NULL, errors);
  if (!code)
    read_facets(&qh, from, chosen, place, out);
  qh_freeqhull(&qh, !qh_ALL);
  qh_memfreeshort(&qh, &left, &total);
  rewind(errors);
  if (!code || !fgets(said, sizeof said, errors))
    said[0] = 0;
  fclose(errors);
  pags_result result = PAGS_OK;
  if (code)
    result = pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points: %.*s", (long long)count,
                       (int)strcspn(said, "\n"), said);
  return result == PAGS_OK ? pags_proxy_mesh_check(out) : result;
}

pags_result pags_proxy_mesh_hull(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out) {
  int64_t most = budget / 2 + 2, count = 0;
  *out = (pags_proxy_mesh){0};
  if (from->vertex_count < 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points", (long long)from->vertex_count);
  int64_t *chosen = malloc((size_t)most * sizeof *chosen);
  double *points = malloc((size_t)most * 3 * sizeof *points);
  uint32_t *place = malloc((size_t)most * sizeof *place);
  pags_result result = chosen && points && place ? PAGS_OK : pags_out_of_memory("a convex hull");
  if (result == PAGS_OK) {
    count = farthest(from, most, chosen);
    for (int64_t i = 0; i < 3 * count; i++)
      points[i] = (double)from->positions[3 * chosen[i / 3] + i % 3];
    memset(place, 0xff, (size_t)most * sizeof *place);
    if (count < 0)
      result = pags_out_of_memory("a convex hull");
    else
      result = count < 4 ? pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points", (long long)count)
                         : run_qhull(from, chosen, count, points, place, out);
  }
  free(chosen);
  free(points);
  free(place);
  if (result != PAGS_OK)
    pags_proxy_mesh_destroy(out);
  return result;
}
