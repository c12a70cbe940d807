/* SPDX-License-Identifier: Apache-2.0 */
/* Triangle meshes: building, connected components (union-find over shared vertices), areas and normals, and whether a
 * mesh is closed. */
#include "exporters/proxy/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/mesh_query.h"

void pags_proxy_mesh_destroy(pags_proxy_mesh *surface) {
  free(surface->positions);
  free(surface->colors);
  free(surface->observed);
  free(surface->triangles);
  memset(surface, 0, sizeof *surface);
}

pags_result pags_proxy_mesh_check(const pags_proxy_mesh *surface) {
  return surface->failed ? pags_out_of_memory("a mesh of %lld triangles", (long long)surface->triangle_count) : PAGS_OK;
}

/* ---- Building ---- */

uint32_t pags_proxy_mesh_vertex(pags_proxy_mesh *surface, const float position[3], const float color[3], int observed) {
  if (surface->failed)
    return 0;
  const int64_t i = surface->vertex_count;
  int64_t room[3] = {surface->vertex_capacity, surface->vertex_capacity, surface->vertex_capacity};
  if (i >= UINT32_MAX - 1 || !pags_grow(&surface->positions, i + 1, &room[0], 3 * sizeof(float)) ||
      !pags_grow(&surface->colors, i + 1, &room[1], 3 * sizeof(float)) ||
      !pags_grow(&surface->observed, i + 1, &room[2], 1)) {
    surface->failed = true;
    return 0;
  }
  surface->vertex_capacity = room[2];
  surface->vertex_count++;
  pags_copy3f(position, surface->positions + 3 * i);
  pags_copy3f(color, surface->colors + 3 * i);
  surface->observed[i] = (uint8_t)observed;
  return (uint32_t)i;
}

void pags_proxy_mesh_triangle(pags_proxy_mesh *surface, uint32_t a, uint32_t b, uint32_t c) {
  if (surface->failed || a == b || b == c || c == a)
    return;
  if (!pags_grow(&surface->triangles, surface->triangle_count + 1, &surface->triangle_capacity, 3 * sizeof(uint32_t))) {
    surface->failed = true;
    return;
  }
  memcpy(surface->triangles + 3 * surface->triangle_count++, (const uint32_t[3]){a, b, c}, 3 * sizeof(uint32_t));
}

pags_result pags_proxy_mesh_append(const pags_proxy_mesh *from, pags_proxy_mesh *to) {
  const uint32_t first = (uint32_t)to->vertex_count;
  for (int64_t i = 0; i < from->vertex_count; i++)
    pags_proxy_mesh_vertex(to, from->positions + 3 * i, from->colors + 3 * i, from->observed[i]);
  for (int64_t i = 0; i < from->triangle_count; i++) {
    const uint32_t *t = from->triangles + 3 * i;
    pags_proxy_mesh_triangle(to, first + t[0], first + t[1], first + t[2]);
  }
  return pags_proxy_mesh_check(to);
}

pags_result pags_proxy_mesh_copy(const pags_proxy_mesh *from, pags_proxy_mesh *out) {
  *out = (pags_proxy_mesh){0};
  return pags_proxy_mesh_append(from, out);
}

pags_result pags_proxy_mesh_copy_part(const pags_proxy_mesh *from, const uint32_t *triangles, int64_t count,
                                      pags_proxy_mesh *out) {
  pags_proxy_mesh view = *from; /* shares the vertices */
  view.triangles = (uint32_t *)(uintptr_t)triangles;
  view.triangle_count = count;
  PAGS_TRY(pags_proxy_mesh_copy(&view, out));
  return pags_proxy_mesh_compact(out);
}

pags_result pags_proxy_mesh_compact(pags_proxy_mesh *surface) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh out = {0};
  PAGS_AUTOFREE uint32_t *place = malloc(((size_t)surface->vertex_count + 1) * sizeof *place);
  PAGS_CHECK_MEMORY(place, "%lld vertices", (long long)surface->vertex_count);
  memset(place, 0xff, ((size_t)surface->vertex_count + 1) * sizeof *place);
  for (int64_t i = 0; i < 3 * surface->triangle_count; i++) {
    uint32_t v = surface->triangles[i];
    if (place[v] == UINT32_MAX)
      place[v] = pags_proxy_mesh_vertex(&out, surface->positions + 3 * (int64_t)v, surface->colors + 3 * (int64_t)v,
                                        surface->observed[v]);
    surface->triangles[i] = place[v];
  }
  surface->failed |= out.failed;
  PAGS_TRY(pags_proxy_mesh_check(surface));
  out.triangles = pags_take(&surface->triangles);
  out.triangle_count = surface->triangle_count;
  out.triangle_capacity = surface->triangle_capacity;
  const pags_proxy_mesh before = *surface;
  *surface = out;
  out = before;
  return PAGS_OK;
}

pags_result pags_proxy_mesh_box(const double size[3], const float color[3], pags_proxy_mesh *out) {
  /* Corner i lies at the positive end of axis k if bit k of i is set. Faces run counter-clockwise seen from
   * outside. */
  static const uint32_t faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  *out = (pags_proxy_mesh){0};
  for (int i = 0; i < 8; i++) {
    float p[3];
    for (int k = 0; k < 3; k++)
      p[k] = (float)(i >> k & 1 ? 0.5 * size[k] : -0.5 * size[k]);
    pags_proxy_mesh_vertex(out, p, color, 1);
  }
  for (int f = 0; f < 6; f++) {
    pags_proxy_mesh_triangle(out, faces[f][0], faces[f][1], faces[f][2]);
    pags_proxy_mesh_triangle(out, faces[f][0], faces[f][2], faces[f][3]);
  }
  return pags_proxy_mesh_check(out);
}

void pags_proxy_mesh_prism(pags_proxy_mesh *mesh, int sides, double (*first)[3], double (*second)[3],
                           const float color[3], const bool observed[2]) {
  const uint32_t a = (uint32_t)mesh->vertex_count, b = a + (uint32_t)sides;
  for (int i = 0; i < 2 * sides; i++) {
    float p[3];
    pags_narrow3(i < sides ? first[i] : second[i - sides], p);
    pags_proxy_mesh_vertex(mesh, p, color, observed[i >= sides]);
  }
  for (uint32_t i = 0; i < (uint32_t)sides; i++) {
    const uint32_t next = (i + 1) % (uint32_t)sides;
    pags_proxy_mesh_triangle(mesh, a + i, a + next, b + next);
    pags_proxy_mesh_triangle(mesh, a + i, b + next, b + i);
    if (i > 0 && next > 0) {
      pags_proxy_mesh_triangle(mesh, a, a + next, a + i);
      pags_proxy_mesh_triangle(mesh, b, b + i, b + next);
    }
  }
}

void pags_proxy_mesh_drop_marked(pags_proxy_mesh *mesh) {
  int64_t kept = 0;
  for (int64_t i = 0; i < mesh->triangle_count; i++)
    if (mesh->triangles[3 * i] != UINT32_MAX)
      memmove(mesh->triangles + 3 * kept++, mesh->triangles + 3 * i, 3 * sizeof(uint32_t));
  mesh->triangle_count = kept;
}

/* ---- Places, areas and normals ---- */

void pags_proxy_mesh_corners(const pags_proxy_mesh *mesh, int64_t triangle, double out[3][3]) {
  for (int c = 0; c < 3; c++)
    pags_proxy_mesh_point(mesh, mesh->triangles[3 * triangle + c], out[c]);
}

/* The cross product of two edges of a triangle, in double: its normal with twice its area as length. */
void pags_proxy_mesh_cross(const pags_proxy_mesh *mesh, int64_t triangle, double out[3]) {
  double p[3][3], u[3], v[3];
  pags_proxy_mesh_corners(mesh, triangle, p);
  pags_subtract3(p[1], p[0], u);
  pags_subtract3(p[2], p[0], v);
  pags_cross3(u, v, out);
}

void pags_proxy_mesh_middle(const pags_proxy_mesh *mesh, int64_t triangle, double out[3]) {
  double p[3][3];
  pags_proxy_mesh_corners(mesh, triangle, p);
  for (int k = 0; k < 3; k++)
    out[k] = p[0][k] / 3 + p[1][k] / 3 + p[2][k] / 3;
}

void pags_proxy_mesh_bounds(const pags_proxy_mesh *mesh, double lo[3], double hi[3]) {
  double p[3];
  for (int k = 0; k < 3; k++) {
    lo[k] = HUGE_VAL;
    hi[k] = -HUGE_VAL;
  }
  for (int64_t i = 0; i < mesh->vertex_count; i++) {
    pags_proxy_mesh_point(mesh, i, p);
    pags_box_add3(p, lo, hi);
  }
}

void pags_proxy_mesh_normals(const pags_proxy_mesh *surface, float *normals) {
  memset(normals, 0, (size_t)surface->vertex_count * 3 * sizeof *normals);
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    double n[3];
    pags_proxy_mesh_cross(surface, i, n);
    for (int c = 0; c < 3; c++)
      for (int k = 0; k < 3; k++)
        normals[3 * (int64_t)surface->triangles[3 * i + c] + k] += (float)n[k];
  }
  for (int64_t i = 0; i < surface->vertex_count; i++) {
    double n[3];
    pags_widen3(normals + 3 * i, n);
    const double length = pags_length3(n);
    for (int k = 0; k < 3; k++)
      normals[3 * i + k] = length > 1e-30 ? (float)(n[k] / length) : (float)(k == 2);
  }
}

/* ---- Connected components ---- */

/* Components smaller than this fraction of the largest are floaters and are removed, wherever they lie. */
static const double crumb = 0.001;

int64_t pags_set_root(int64_t *parent, int64_t i) {
  while (parent[i] != i) {
    parent[i] = parent[parent[i]];
    i = parent[i];
  }
  return i;
}

void pags_set_join(int64_t *parent, int64_t a, int64_t b) {
  a = pags_set_root(parent, a);
  b = pags_set_root(parent, b);
  parent[a < b ? b : a] = a < b ? a : b;
}

void pags_proxy_mesh_connect(const pags_proxy_mesh *mesh, int64_t *parent) {
  for (int64_t i = 0; i < mesh->vertex_count; i++)
    parent[i] = i;
  for (int64_t i = 0; i < 3 * mesh->triangle_count; i++)
    pags_set_join(parent, mesh->triangles[i], mesh->triangles[i - i % 3]);
}

/* The connected components of a mesh as a union-find over vertices. The representative of a component is its vertex
 * of the least number. */
typedef struct parts {
  int64_t *parent;
  double *area, largest; /* area of the component, kept at its representative; the largest of them; square metres */
} parts;

static void forget_parts(parts *p) {
  free(p->parent);
  free(p->area);
}

static pags_result measure_parts(const pags_proxy_mesh *s, parts *out) {
  size_t room = (size_t)s->vertex_count + 1;
  *out = (parts){.parent = malloc(room * sizeof *out->parent), .area = calloc(room, sizeof *out->area)};
  PAGS_CHECK_MEMORY(out->parent && out->area, "%lld vertices", (long long)s->vertex_count);

  pags_proxy_mesh_connect(s, out->parent);
  for (int64_t i = 0; i < s->triangle_count; i++) {
    double n[3];
    pags_proxy_mesh_cross(s, i, n);
    out->area[pags_set_root(out->parent, s->triangles[3 * i])] += 0.5 * pags_length3(n);
  }
  for (int64_t i = 0; i < s->vertex_count; i++)
    out->largest = fmax(out->largest, out->area[i]);
  return PAGS_OK;
}

/* Raises the area of a small component to `large`, so that it is kept, if one of its vertices lies in the box of this
 * size and closer than `reach` metres to a component that is large. */
static pags_result annex_parts(const pags_proxy_mesh *s, parts *p, double large, double reach, const double size[3]) {
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *query = NULL;
  PAGS_AUTOFREE uint32_t *triangles = malloc((3 * (size_t)s->triangle_count + 1) * sizeof *triangles);
  PAGS_CHECK_MEMORY(triangles, "%lld triangles", (long long)s->triangle_count);
  pags_proxy_mesh main = *s;
  main.triangles = triangles;
  main.triangle_count = 0;
  for (int64_t i = 0; i < s->triangle_count; i++)
    if (p->area[pags_set_root(p->parent, s->triangles[3 * i])] >= large)
      memcpy(triangles + 3 * main.triangle_count++, s->triangles + 3 * i, 3 * sizeof *triangles);
  PAGS_TRY(pags_mesh_query_of_mesh(&main, &query));
  for (int64_t i = 0; i < s->vertex_count; i++) {
    double at[3], *area = &p->area[pags_set_root(p->parent, i)];
    pags_proxy_mesh_point(s, i, at);
    const bool within = fabs(at[0]) <= 0.5 * size[0] && fabs(at[1]) <= 0.5 * size[1] && fabs(at[2]) <= 0.5 * size[2];
    if (within && *area < large && *area >= crumb * p->largest && pags_mesh_query_distance(query, at, NULL) < reach)
      *area = large;
  }
  return PAGS_OK;
}

static pags_result drop_parts(pags_proxy_mesh *s, parts *p, double least) {
  for (int64_t i = 0; i < s->triangle_count; i++)
    if (!(p->area[pags_set_root(p->parent, s->triangles[3 * i])] >= least))
      s->triangles[3 * i] = UINT32_MAX;
  pags_proxy_mesh_drop_marked(s);
  return pags_proxy_mesh_compact(s);
}

pags_result pags_proxy_mesh_keep_parts(pags_proxy_mesh *mesh, double share, double reach, const double *size) {
  PAGS_AUTO(forget_parts) parts p = {0};
  PAGS_TRY(measure_parts(mesh, &p));
  const double large = share * p.largest;
  if (size)
    PAGS_TRY(annex_parts(mesh, &p, large, reach, size));
  return drop_parts(mesh, &p, large);
}

pags_result pags_proxy_mesh_drop_floaters(pags_proxy_mesh *surface, double area) {
  PAGS_AUTO(forget_parts) parts p = {0};
  PAGS_TRY(measure_parts(surface, &p));
  return drop_parts(surface, &p, area);
}

/* ---- Topology ---- */

static int compare_edges(const void *left, const void *right) {
  uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
  return a < b ? -1 : a > b;
}

pags_result pags_proxy_mesh_inspect(const pags_proxy_mesh *surface, pags_proxy_mesh_topology *out) {
  const int64_t count = 3 * surface->triangle_count;
  *out = (pags_proxy_mesh_topology){0};
  PAGS_AUTOFREE uint64_t *edges =
      surface->vertex_count < INT32_MAX ? malloc(((size_t)count + 1) * sizeof *edges) : NULL;
  PAGS_CHECK_MEMORY(edges, "%lld edges", (long long)count);

  /* Sort the edges of all triangles, each packed in 31 + 31 + 1 bits: smaller vertex, larger vertex, and 1 if the face
   * runs from the larger to the smaller. */
  for (int64_t i = 0; i < count; i++) {
    const uint64_t a = surface->triangles[i], b = surface->triangles[i % 3 == 2 ? i - 2 : i + 1];
    edges[i] = a < b ? a << 32 | b << 1 : b << 32 | a << 1 | 1;
  }
  pags_sort(edges, count, sizeof *edges, compare_edges);
  for (int64_t i = 0, end; i < count; i = end) {
    int64_t backward = 0;
    for (end = i; end < count && edges[end] >> 1 == edges[i] >> 1; end++)
      backward += (int64_t)(edges[end] & 1);
    out->open_edges += end - i == 1;
    out->crossed_edges += end - i > 2 || (end - i == 2 && backward != 1);
  }
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    double a[3], n[3];
    pags_proxy_mesh_point(surface, surface->triangles[3 * i], a);
    pags_proxy_mesh_cross(surface, i, n);
    out->volume += pags_dot3(n, a) / 6;
  }
  out->closed = count > 0 && !out->open_edges && !out->crossed_edges && out->volume > 0;
  return PAGS_OK;
}
