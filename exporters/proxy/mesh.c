/* SPDX-License-Identifier: Apache-2.0 */
/* Triangle meshes: building, connected components (union-find over shared vertices), areas and normals, and whether a
 * mesh is closed. */
#include "exporters/proxy/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
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

/* Reallocates `*array` to `count` items of `size` bytes; false when out of memory. */
static bool grow(void **array, int64_t count, size_t size) {
  void *grown = realloc(*array, (size_t)count * size);
  if (grown)
    *array = grown;
  return grown != NULL;
}

uint32_t pags_proxy_mesh_vertex(pags_proxy_mesh *surface, const float position[3], const float color[3], int observed) {
  if (surface->failed)
    return 0;
  if (surface->vertex_count == surface->vertex_capacity) {
    int64_t capacity = 2 * surface->vertex_capacity + 256;
    if (capacity > UINT32_MAX - 1 || !grow((void **)&surface->positions, capacity, 3 * sizeof(float)) ||
        !grow((void **)&surface->colors, capacity, 3 * sizeof(float)) ||
        !grow((void **)&surface->observed, capacity, 1)) {
      surface->failed = true;
      return 0;
    }
    surface->vertex_capacity = capacity;
  }
  int64_t i = surface->vertex_count++;
  memcpy(surface->positions + 3 * i, position, 3 * sizeof(float));
  memcpy(surface->colors + 3 * i, color, 3 * sizeof(float));
  surface->observed[i] = (uint8_t)observed;
  return (uint32_t)i;
}

void pags_proxy_mesh_triangle(pags_proxy_mesh *surface, uint32_t a, uint32_t b, uint32_t c) {
  if (surface->failed || a == b || b == c || c == a)
    return;
  if (surface->triangle_count == surface->triangle_capacity) {
    int64_t capacity = 2 * surface->triangle_capacity + 256;
    if (!grow((void **)&surface->triangles, capacity, 3 * sizeof(uint32_t))) {
      surface->failed = true;
      return;
    }
    surface->triangle_capacity = capacity;
  }
  uint32_t *t = surface->triangles + 3 * surface->triangle_count++;
  t[0] = a;
  t[1] = b;
  t[2] = c;
}

pags_result pags_proxy_mesh_copy(const pags_proxy_mesh *from, pags_proxy_mesh *to) {
  *to = (pags_proxy_mesh){0};
  for (int64_t i = 0; i < from->vertex_count; i++)
    pags_proxy_mesh_vertex(to, from->positions + 3 * i, from->colors + 3 * i, from->observed[i]);
  for (int64_t i = 0; i < from->triangle_count; i++) {
    const uint32_t *t = from->triangles + 3 * i;
    pags_proxy_mesh_triangle(to, t[0], t[1], t[2]);
  }
  pags_result result = pags_proxy_mesh_check(to);
  if (result != PAGS_OK)
    pags_proxy_mesh_destroy(to);
  return result;
}

pags_result pags_proxy_mesh_compact(pags_proxy_mesh *surface) {
  pags_proxy_mesh out = {0};
  uint32_t *place = malloc(((size_t)surface->vertex_count + 1) * sizeof *place);
  PAGS_CHECK_MEMORY(place, "%lld vertices", (long long)surface->vertex_count);
  memset(place, 0xff, ((size_t)surface->vertex_count + 1) * sizeof *place);
  for (int64_t i = 0; i < 3 * surface->triangle_count; i++) {
    uint32_t v = surface->triangles[i];
    if (place[v] == UINT32_MAX)
      place[v] = pags_proxy_mesh_vertex(&out, surface->positions + 3 * (int64_t)v, surface->colors + 3 * (int64_t)v,
                                        surface->observed[v]);
    surface->triangles[i] = place[v];
  }
  free(place);
  if (out.failed) {
    pags_proxy_mesh_destroy(&out);
    surface->failed = true;
    return pags_proxy_mesh_check(surface);
  }
  out.triangles = surface->triangles;
  out.triangle_count = surface->triangle_count;
  out.triangle_capacity = surface->triangle_capacity;
  surface->triangles = NULL;
  pags_proxy_mesh_destroy(surface);
  *surface = out;
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
  pags_result result = pags_proxy_mesh_check(out);
  if (result != PAGS_OK)
    pags_proxy_mesh_destroy(out);
  return result;
}

/* ---- Areas and normals ---- */

/* The cross product of two edges of a triangle, in double: its normal with twice its area as length. */
static void cross_of(const pags_proxy_mesh *s, int64_t triangle, double n[3]) {
  const uint32_t *t = s->triangles + 3 * triangle;
  const float *a = s->positions + 3 * (int64_t)t[0], *b = s->positions + 3 * (int64_t)t[1],
              *c = s->positions + 3 * (int64_t)t[2];
  double u[3], v[3];
  for (int k = 0; k < 3; k++) {
    u[k] = (double)b[k] - (double)a[k];
    v[k] = (double)c[k] - (double)a[k];
  }
  for (int k = 0; k < 3; k++)
    n[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
}

double pags_proxy_mesh_area(const pags_proxy_mesh *surface) {
  double sum = 0, n[3];
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    cross_of(surface, i, n);
    sum += 0.5 * pags_length3(n);
  }
  return sum;
}

void pags_proxy_mesh_normals(const pags_proxy_mesh *surface, float *normals) {
  memset(normals, 0, (size_t)surface->vertex_count * 3 * sizeof *normals);
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    double n[3];
    cross_of(surface, i, n);
    for (int c = 0; c < 3; c++)
      for (int k = 0; k < 3; k++)
        normals[3 * (int64_t)surface->triangles[3 * i + c] + k] += (float)n[k];
  }
  for (int64_t i = 0; i < surface->vertex_count; i++) {
    float *n = normals + 3 * i;
    double length = sqrt((double)n[0] * (double)n[0] + (double)n[1] * (double)n[1] + (double)n[2] * (double)n[2]);
    for (int k = 0; k < 3; k++)
      n[k] = length > 1e-30 ? (float)((double)n[k] / length) : (float)(k == 2);
  }
}

/* ---- Connected components ---- */

/* Components smaller than this fraction of the largest are floaters and are removed, wherever they lie. */
static const double crumb = 0.001;

/* Union-find: the representative of a vertex's component. */
static uint32_t root_of(uint32_t *parent, uint32_t i) {
  while (parent[i] != i) {
    parent[i] = parent[parent[i]];
    i = parent[i];
  }
  return i;
}

/* The connected components of a mesh as a union-find over vertices. The representative of a component is its vertex
 * of the least number. */
typedef struct parts {
  uint32_t *parent;
  double *area, largest; /* area of the component, kept at its representative; the largest of them; square metres */
} parts;

static void forget_parts(parts *p) {
  free(p->parent);
  free(p->area);
}

static pags_result measure_parts(const pags_proxy_mesh *s, parts *out) {
  size_t room = (size_t)s->vertex_count + 1;
  *out = (parts){.parent = malloc(room * sizeof *out->parent), .area = calloc(room, sizeof *out->area)};
  if (!out->parent || !out->area) {
    forget_parts(out);
    return pags_out_of_memory("%lld vertices", (long long)s->vertex_count);
  }

  /* Join the corners of each triangle. */
  for (int64_t i = 0; i < s->vertex_count; i++)
    out->parent[i] = (uint32_t)i;
  for (int64_t i = 0; i < s->triangle_count; i++)
    for (int c = 1; c < 3; c++) {
      uint32_t a = root_of(out->parent, s->triangles[3 * i]), b = root_of(out->parent, s->triangles[3 * i + c]);
      out->parent[a < b ? b : a] = a < b ? a : b;
    }

  for (int64_t i = 0; i < s->triangle_count; i++) {
    double n[3];
    cross_of(s, i, n);
    out->area[root_of(out->parent, s->triangles[3 * i])] += 0.5 * pags_length3(n);
  }
  for (int64_t i = 0; i < s->vertex_count; i++)
    out->largest = fmax(out->largest, out->area[i]);
  return PAGS_OK;
}

/* Raises the area of a small component to `large`, so that it is kept, if one of its vertices lies in the box of this
 * size and closer than `reach` metres to a component that is large. */
static pags_result annex_parts(const pags_proxy_mesh *s, parts *p, double large, double reach, const double size[3]) {
  pags_proxy_mesh main = *s;
  pags_mesh_query *query = NULL;
  main.triangle_count = 0;
  main.triangles = malloc((3 * (size_t)s->triangle_count + 1) * sizeof *main.triangles);
  PAGS_CHECK_MEMORY(main.triangles, "%lld triangles", (long long)s->triangle_count);
  for (int64_t i = 0; i < s->triangle_count; i++)
    if (p->area[root_of(p->parent, s->triangles[3 * i])] >= large)
      memcpy(main.triangles + 3 * main.triangle_count++, s->triangles + 3 * i, 3 * sizeof(uint32_t));
  pags_result result = pags_mesh_query_of_mesh(&main, &query);
  for (int64_t i = 0; i < s->vertex_count && result == PAGS_OK; i++) {
    const double at[3] = {(double)s->positions[3 * i], (double)s->positions[3 * i + 1],
                          (double)s->positions[3 * i + 2]};
    double *area = &p->area[root_of(p->parent, (uint32_t)i)];
    int within = fabs(at[0]) <= 0.5 * size[0] && fabs(at[1]) <= 0.5 * size[1] && fabs(at[2]) <= 0.5 * size[2];
    if (within && *area < large && *area >= crumb * p->largest && pags_mesh_query_distance(query, at, NULL) < reach)
      *area = large;
  }
  pags_mesh_query_destroy(query);
  free(main.triangles);
  return result;
}

static pags_result drop_parts(pags_proxy_mesh *s, parts *p, double least) {
  int64_t kept = 0;
  for (int64_t i = 0; i < s->triangle_count; i++)
    if (p->area[root_of(p->parent, s->triangles[3 * i])] >= least)
      memmove(s->triangles + 3 * kept++, s->triangles + 3 * i, 3 * sizeof(uint32_t));
  s->triangle_count = kept;
  return pags_proxy_mesh_compact(s);
}

pags_result pags_proxy_mesh_keep_parts(pags_proxy_mesh *mesh, double share, double reach, const double *size) {
  parts p;
  PAGS_TRY(measure_parts(mesh, &p));
  double large = share * p.largest;
  pags_result result = size ? annex_parts(mesh, &p, large, reach, size) : PAGS_OK;
  if (result == PAGS_OK)
    result = drop_parts(mesh, &p, large);
  forget_parts(&p);
  return result;
}

pags_result pags_proxy_mesh_drop_floaters(pags_proxy_mesh *surface, double area) {
  parts p;
  PAGS_TRY(measure_parts(surface, &p));
  pags_result result = drop_parts(surface, &p, area);
  forget_parts(&p);
  return result;
}

/* ---- Topology ---- */

static int compare_edges(const void *left, const void *right) {
  uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
  return a < b ? -1 : a > b;
}

/* The edges of all triangles, sorted, each packed in 31 + 31 + 1 bits: smaller vertex, larger vertex, and 1 if the
 * face runs from the larger to the smaller. */
static uint64_t *sorted_edges(const pags_proxy_mesh *s) {
  int64_t count = 3 * s->triangle_count;
  uint64_t *edges = malloc(((size_t)count + 1) * sizeof *edges);
  for (int64_t i = 0; edges && i < count; i++) {
    uint64_t a = s->triangles[i], b = s->triangles[i % 3 == 2 ? i - 2 : i + 1];
    edges[i] = a < b ? a << 32 | b << 1 : b << 32 | a << 1 | 1;
  }
  if (edges)
    pags_sort(edges, count, sizeof *edges, compare_edges);
  return edges;
}

pags_result pags_proxy_mesh_inspect(const pags_proxy_mesh *surface, pags_proxy_mesh_topology *out) {
  int64_t count = 3 * surface->triangle_count;
  uint64_t *edges = surface->vertex_count < INT32_MAX ? sorted_edges(surface) : NULL;
  *out = (pags_proxy_mesh_topology){0};
  PAGS_CHECK_MEMORY(edges, "%lld edges", (long long)count);
  for (int64_t i = 0, end; i < count; i = end) {
    int64_t backward = 0;
    for (end = i; end < count && edges[end] >> 1 == edges[i] >> 1; end++)
      backward += (int64_t)(edges[end] & 1);
    out->open_edges += end - i == 1;
    out->crossed_edges += end - i > 2 || (end - i == 2 && backward != 1);
  }
  free(edges);
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    const float *a = surface->positions + 3 * (int64_t)surface->triangles[3 * i];
    double n[3];
    cross_of(surface, i, n);
    out->volume += (n[0] * (double)a[0] + n[1] * (double)a[1] + n[2] * (double)a[2]) / 6;
  }
  out->closed = count > 0 && !out->open_edges && !out->crossed_edges && out->volume > 0;
  return PAGS_OK;
}
