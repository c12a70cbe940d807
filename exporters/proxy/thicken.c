/* SPDX-License-Identifier: Apache-2.0 */
/* Makes a closed slab of a sheet that is seen from above: a copy of it below, turned over, and a rim. */
#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/mesh.h"

/* An edge of a triangle, by vertices: the smaller number first, and whether the face runs from the larger one. */
typedef struct edge {
  uint32_t low, high;
  bool backward;
} edge;

static int compare_edges(const void *left, const void *right) {
  const edge *a = left, *b = right;
  if (a->low != b->low)
    return a->low < b->low ? -1 : 1;
  if (a->high != b->high)
    return a->high < b->high ? -1 : 1;
  return (a->backward > b->backward) - (a->backward < b->backward);
}

pags_result pags_proxy_mesh_thicken(pags_proxy_mesh *mesh, double depth) {
  const int64_t count = 3 * mesh->triangle_count;
  const uint32_t below = (uint32_t)mesh->vertex_count; /* what to add to a vertex for its copy */
  PAGS_AUTOFREE edge *edges = malloc(((size_t)count + 1) * sizeof *edges);
  PAGS_CHECK_MEMORY(edges, "%lld edges", (long long)count);
  for (int64_t i = 0; i < count; i++) {
    const uint32_t a = mesh->triangles[i], b = mesh->triangles[i % 3 == 2 ? i - 2 : i + 1];
    edges[i] = (edge){a < b ? a : b, a < b ? b : a, a > b};
  }
  pags_sort(edges, count, sizeof *edges, compare_edges);
  for (uint32_t v = 0; v < below; v++) {
    float p[3], color[3];
    pags_copy3f(mesh->positions + 3 * (size_t)v, p);
    pags_copy3f(mesh->colors + 3 * (size_t)v, color);
    p[2] -= (float)depth;
    pags_proxy_mesh_vertex(mesh, p, color, 0);
  }
  for (int64_t i = 0; i < count; i += 3) {
    const uint32_t a = mesh->triangles[i], b = mesh->triangles[i + 1], c = mesh->triangles[i + 2];
    pags_proxy_mesh_triangle(mesh, below + a, below + c, below + b);
  }
  for (int64_t i = 0, end; i < count; i = end) {
    for (end = i + 1; end < count && edges[end].low == edges[i].low && edges[end].high == edges[i].high; end++)
      continue;
    if (end - i > 1)
      continue;
    const uint32_t a = edges[i].backward ? edges[i].high : edges[i].low,
                   b = edges[i].backward ? edges[i].low : edges[i].high;
    pags_proxy_mesh_triangle(mesh, b, a, below + a);
    pags_proxy_mesh_triangle(mesh, b, below + a, below + b);
  }
  PAGS_TRY(pags_proxy_mesh_check(mesh));
  return pags_proxy_mesh_repair(mesh);
}
