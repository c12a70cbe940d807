/* SPDX-License-Identifier: Apache-2.0 */
/* Makes a mesh fit for physics: no triangle without area, no two triangles at the same place, no edge of more than two
 * faces, also where vertices at the same place are taken for one.
 *
 * A triangle without area is a needle, whose shortest edge is collapsed, or a cap, whose corner lies on its longest
 * edge: that edge is flipped. Edges of too many faces are split (repair.c); the copies of a vertex that this makes
 * are drawn a little towards their own faces. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"

#include "exporters/proxy/mesh.h"

enum { PASSES = 12 };

static const double least_area = 2e-10; /* square metres; less where the whole mesh is smaller than 0.1 m */
static const double needle = 0.02;      /* a needle's shortest edge is at most this share of its longest */
static const double apart = 0.01;       /* how far copies of a vertex move towards the middle of their faces */

/* ---- Triangles without area ---- */

/* A directed edge of a face: it leaves corner `id` % 3 of triangle `id` / 3. */
typedef struct edge {
  uint32_t from, to;
  int64_t id;
} edge;

static int compare_edges(const void *left, const void *right) {
  const edge *a = left, *b = right;
  if (a->from != b->from)
    return a->from < b->from ? -1 : 1;
  if (a->to != b->to)
    return a->to < b->to ? -1 : 1;
  return a->id < b->id ? -1 : a->id > b->id;
}

/* The half-edge from `from` to `to`; -1 if missing or ambiguous. */
static int64_t find_edge(const edge *edges, int64_t count, uint32_t from, uint32_t to) {
  int64_t lo = 0, hi = count;
  while (lo < hi) {
    const int64_t mid = lo + (hi - lo) / 2;
    if (edges[mid].from < from || (edges[mid].from == from && edges[mid].to < to))
      lo = mid + 1;
    else
      hi = mid;
  }
  if (lo == count || edges[lo].from != from || edges[lo].to != to)
    return -1;
  return lo + 1 < count && edges[lo + 1].from == from && edges[lo + 1].to == to ? -1 : edges[lo].id;
}

/* Mends one triangle: `onto`[v] is set for a vertex that is joined to another; `busy` marks triangles that were changed
 * in this pass. Returns whether anything was done. */
static bool mend(pags_proxy_mesh *s, int64_t triangle, const edge *edges, uint32_t *onto, uint8_t *busy) {
  uint32_t *t = s->triangles + 3 * triangle;
  double p[3][3], length[3];
  int longest = 0, shortest = 0;
  pags_proxy_mesh_corners(s, triangle, p);
  for (int c = 0; c < 3; c++) {
    length[c] = pags_distance3(p[(c + 1) % 3], p[c]);
    longest = length[c] > length[longest] ? c : longest;
    shortest = length[c] < length[shortest] ? c : shortest;
  }
  const uint32_t a = t[longest], b = t[(longest + 1) % 3], corner = t[(longest + 2) % 3];
  const int64_t other = find_edge(edges, 3 * s->triangle_count, b, a);
  if (other >= 0 && length[shortest] > needle * length[longest]) {
    if (busy[other / 3])
      return false;
    uint32_t *o = s->triangles + 3 * (other / 3);
    const uint32_t far = o[(other % 3 + 2) % 3];
    if (far == corner)
      return false;
    memcpy(t, (const uint32_t[3]){corner, a, far}, 3 * sizeof *t);
    memcpy(o, (const uint32_t[3]){far, b, corner}, 3 * sizeof *o);
    busy[triangle] = busy[other / 3] = 1;
    return true;
  }
  const uint32_t from = t[shortest], to = t[(shortest + 1) % 3];
  if (onto[from] != from || onto[to] != to)
    return false;
  onto[from > to ? from : to] = from > to ? to : from;
  busy[triangle] = 1;
  return true;
}

/* One pass over all triangles without area; `found` receives how many there were. */
static pags_result mend_all(pags_proxy_mesh *s, double limit, int64_t *found) {
  *found = 0;
  PAGS_AUTOFREE uint8_t *busy = calloc((size_t)s->triangle_count + 1, 1);
  PAGS_CHECK_MEMORY(busy, "%lld triangles", (long long)s->triangle_count);
  for (int64_t i = 0; i < s->triangle_count; i++) {
    double n[3];
    pags_proxy_mesh_cross(s, i, n);
    busy[i] = 0.5 * pags_length3(n) < limit ? 2 : 0;
    *found += busy[i] == 2;
  }
  if (!*found)
    return PAGS_OK;
  const int64_t edge_count = 3 * s->triangle_count;
  PAGS_AUTOFREE edge *edges = malloc(((size_t)edge_count + 1) * sizeof *edges);
  PAGS_AUTOFREE uint32_t *onto = malloc(((size_t)s->vertex_count + 1) * sizeof *onto);
  PAGS_CHECK_MEMORY(edges && onto, "%lld edges", (long long)s->triangle_count);
  for (int64_t i = 0; i < edge_count; i++)
    edges[i] = (edge){s->triangles[i], s->triangles[i % 3 == 2 ? i - 2 : i + 1], i};
  pags_sort(edges, edge_count, sizeof *edges, compare_edges);
  for (int64_t i = 0; i < s->vertex_count; i++)
    onto[i] = (uint32_t)i;
  for (int64_t i = 0; i < s->triangle_count; i++)
    if (busy[i] == 2)
      mend(s, i, edges, onto, busy);
  for (int64_t i = 0; i < s->triangle_count; i++) { /* drop the triangles that have collapsed */
    uint32_t *t = s->triangles + 3 * i;
    for (int c = 0; c < 3; c++)
      t[c] = onto[t[c]];
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
      t[0] = UINT32_MAX;
  }
  pags_proxy_mesh_drop_marked(s);
  return PAGS_OK;
}

/* ---- Doubles ---- */

typedef struct face {
  uint32_t v[3]; /* ascending */
  int64_t triangle;
} face;

static int compare_faces(const void *left, const void *right) {
  const face *a = left, *b = right;
  for (int k = 0; k < 3; k++)
    if (a->v[k] != b->v[k])
      return a->v[k] < b->v[k] ? -1 : 1;
  return a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

/* Keeps one of the faces that have the same three vertices. */
static pags_result drop_doubles(pags_proxy_mesh *s) {
  PAGS_AUTOFREE face *faces = malloc(((size_t)s->triangle_count + 1) * sizeof *faces);
  PAGS_CHECK_MEMORY(faces, "%lld triangles", (long long)s->triangle_count);
  for (int64_t i = 0; i < s->triangle_count; i++) {
    const uint32_t *t = s->triangles + 3 * i;
    const uint32_t low = t[0] < t[1] ? (t[0] < t[2] ? t[0] : t[2]) : (t[1] < t[2] ? t[1] : t[2]);
    const uint32_t high = t[0] > t[1] ? (t[0] > t[2] ? t[0] : t[2]) : (t[1] > t[2] ? t[1] : t[2]);
    faces[i] = (face){{low, t[0] ^ t[1] ^ t[2] ^ low ^ high, high}, i};
  }
  pags_sort(faces, s->triangle_count, sizeof *faces, compare_faces);
  for (int64_t i = 1; i < s->triangle_count; i++)
    if (!memcmp(faces[i].v, faces[i - 1].v, sizeof faces[i].v))
      s->triangles[3 * faces[i].triangle] = UINT32_MAX;
  pags_proxy_mesh_drop_marked(s);
  return PAGS_OK;
}

/* ---- Copies of a vertex ---- */

typedef struct place {
  float p[3];
  int64_t vertex;
} place;

static int compare_places(const void *left, const void *right) {
  const place *a = left, *b = right;
  for (int k = 0; k < 3; k++)
    if (a->p[k] < b->p[k] || a->p[k] > b->p[k])
      return a->p[k] < b->p[k] ? -1 : 1;
  return a->vertex < b->vertex ? -1 : a->vertex > b->vertex;
}

/* Moves vertices that lie at the same place towards the middle of their own faces. */
static pags_result part_copies(pags_proxy_mesh *s) {
  PAGS_AUTOFREE place *places = malloc(((size_t)s->vertex_count + 1) * sizeof *places);
  /* Of each vertex the sum of its faces' middles, and how many these are. */
  PAGS_AUTOFREE double *sum = calloc(4 * (size_t)s->vertex_count + 1, sizeof *sum);
  PAGS_CHECK_MEMORY(places && sum, "%lld vertices", (long long)s->vertex_count);
  for (int64_t i = 0; i < s->triangle_count; i++) {
    double p[3][3];
    pags_proxy_mesh_corners(s, i, p);
    for (int c = 0; c < 3; c++) {
      double *own = sum + 4 * (int64_t)s->triangles[3 * i + c];
      for (int k = 0; k < 3; k++)
        own[k] += (p[0][k] + p[1][k] + p[2][k]) / 3;
      own[3]++;
    }
  }
  for (int64_t i = 0; i < s->vertex_count; i++) {
    pags_copy3f(s->positions + 3 * i, places[i].p);
    places[i].vertex = i;
  }
  pags_sort(places, s->vertex_count, sizeof *places, compare_places);
  for (int64_t i = 0, end; i < s->vertex_count; i = end) {
    for (end = i + 1; end < s->vertex_count && !memcmp(places[end].p, places[i].p, sizeof places[i].p); end++)
      continue;
    for (int64_t j = i; j < end && end - i > 1; j++) {
      const double *own = sum + 4 * places[j].vertex;
      for (int k = 0; k < 3 && own[3] > 0; k++) {
        const double p = (double)places[j].p[k];
        s->positions[3 * places[j].vertex + k] = (float)(p + apart * (own[k] / own[3] - p));
      }
    }
  }
  return PAGS_OK;
}

/* ---- The whole ---- */

pags_result pags_proxy_mesh_clean(pags_proxy_mesh *mesh) {
  pags_proxy_mesh_topology before, after;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh copy = {0};
  if (!mesh->triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_proxy_mesh_inspect(mesh, &before));
  PAGS_TRY(pags_proxy_mesh_copy(mesh, &copy));
  double lo[3], hi[3];
  pags_proxy_mesh_bounds(&copy, lo, hi);
  const double share = fmin(1, pags_distance3(hi, lo) / 0.1), limit = least_area * share * share;
  int64_t found = 1;
  for (int pass = 0; pass < PASSES && found; pass++) {
    PAGS_TRY(mend_all(&copy, limit, &found));
    if (!before.closed)
      PAGS_TRY(drop_doubles(&copy));
    if (pass == 0 || found) {
      PAGS_TRY(pags_proxy_mesh_repair(&copy));
      PAGS_TRY(part_copies(&copy));
    }
  }
  PAGS_TRY(pags_proxy_mesh_compact(&copy));
  PAGS_TRY(pags_proxy_mesh_inspect(&copy, &after));
  if (before.closed && !after.closed)
    return PAGS_OK;
  const pags_proxy_mesh replaced = *mesh;
  *mesh = copy;
  copy = replaced;
  return PAGS_OK;
}
