/* SPDX-License-Identifier: Apache-2.0 */
/* Convex hulls of meshes with a limit of triangles, by qhull (Barber, Dobkin and Huhdanpaa 1996). */
#include <libqhull_r/qhull_ra.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/mesh.h"

#include "base/file.h"
#include "base/memory.h"
#include "maths/maths.h"

/* Chooses the vertices that lie farthest in `count` evenly spread directions (a spherical Fibonacci lattice for the
 * mesh scaled to a cube). The hull of at most `count` vertices has at most 2 count - 4 triangles. Writes the chosen
 * vertices once each, in ascending order, and returns how many; -1 when out of memory. */
static int64_t farthest(const pags_proxy_mesh *s, int64_t count, int64_t *chosen) {
  double lo[3], hi[3], p[3];
  pags_proxy_mesh_bounds(s, lo, hi);
  PAGS_AUTOFREE uint8_t *taken = calloc((size_t)s->vertex_count + 1, 1);
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
      pags_proxy_mesh_point(s, i, p);
      double along = pags_dot3(direction, p);
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
  return found;
}

/* Copies the facets that qhull finds (its option `Qt` makes them triangles) and their vertices into `out`. */
static pags_result run_qhull(const pags_proxy_mesh *from, const int64_t *chosen, int64_t count, double *points,
                             uint32_t *place, pags_proxy_mesh *out) {
  char options[] = "qhull Qt", said[256] = "";
  PAGS_AUTO(pags_file_close) FILE *errors = tmpfile();
  PAGS_CHECK_MEMORY(errors, "a convex hull");
  qhT memory, *qh = &memory;
  facetT *facet;
  vertexT *vertex, **vertexp;
  int left, total;
  qh_zero(qh, errors);
  const int code = qh_new_qhull(qh, 3, (int)count, points, False, options, NULL, errors);
  FORALLfacets {
    uint32_t corners[3] = {0};
    int n = 0;
    if (code) /* nothing was made */
      break;
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
  qh_freeqhull(qh, !qh_ALL);
  qh_memfreeshort(qh, &left, &total);
  if (!code)
    return pags_proxy_mesh_check(out);
  rewind(errors);
  if (!fgets(said, sizeof said, errors))
    said[0] = 0;
  return pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points: %.*s", (long long)count,
                   (int)strcspn(said, "\n"), said);
}

pags_result pags_proxy_mesh_hull(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out) {
  const size_t most = (size_t)(budget / 2 + 2);
  *out = (pags_proxy_mesh){0};
  if (from->vertex_count < 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points", (long long)from->vertex_count);
  PAGS_AUTOFREE int64_t *chosen = malloc(most * sizeof *chosen);
  PAGS_AUTOFREE double *points = malloc(most * 3 * sizeof *points);
  PAGS_AUTOFREE uint32_t *place = malloc(most * sizeof *place);
  const int64_t count = chosen && points && place ? farthest(from, (int64_t)most, chosen) : -1;
  PAGS_CHECK_MEMORY(count >= 0, "a convex hull");
  if (count < 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "no convex hull of %lld points", (long long)count);
  for (int64_t i = 0; i < count; i++)
    pags_proxy_mesh_point(from, chosen[i], points + 3 * i);
  memset(place, 0xff, most * sizeof *place);
  return run_qhull(from, chosen, count, points, place, out);
}
