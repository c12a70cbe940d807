/* SPDX-License-Identifier: Apache-2.0 */
/* Convex meshes of what consists of several closed surfaces: the trunk and the hulls of a tree, the prism and the plate
 * of a sign, the parts of a building. */
#include <stdlib.h>

#include "base/memory.h"
#include "exporters/proxy/convex_parts.h"

static const double convex = 0.98; /* share of its hull's volume that a convex surface has at least */

typedef struct mesh_list {
  pags_proxy_mesh **items;
  int64_t *count, capacity;
} mesh_list;

/* Appends a mesh, which is taken over. */
static pags_result put(mesh_list *list, pags_proxy_mesh *mesh) {
  PAGS_CHECK_MEMORY(pags_grow(list->items, *list->count + 1, &list->capacity, sizeof **list->items),
                    "%lld convex parts", (long long)*list->count + 1);
  (*list->items)[(*list->count)++] = *mesh;
  *mesh = (pags_proxy_mesh){0};
  return PAGS_OK;
}

static pags_result cut(pags_proxy_mesh *surface, mesh_list *list) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh hull = {0}, made = {0};
  pags_proxy_mesh_topology own, whole;
  pags_convex_parts parts;
  PAGS_TRY(pags_proxy_mesh_hull(surface, 2 * PAGS_PART_TRIANGLES, &hull));
  PAGS_TRY(pags_proxy_mesh_inspect(surface, &own));
  PAGS_TRY(pags_proxy_mesh_inspect(&hull, &whole));
  if (own.volume >= convex * whole.volume)
    return put(list, surface);
  PAGS_TRY(pags_proxy_mesh_convex(surface, PAGS_MOST_PARTS * PAGS_PART_TRIANGLES, &made, &parts));
  for (int i = 0; i < parts.count; i++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh part = {0};
    PAGS_TRY(pags_convex_part(&made, &parts, i, &part));
    PAGS_TRY(put(list, &part));
  }
  return PAGS_OK;
}

pags_result pags_convex_meshes_make(const pags_proxy_mesh *mesh, pags_proxy_mesh **out, int64_t *count) {
  mesh_list list = {.items = out, .count = count};
  PAGS_AUTOFREE int64_t *parent = malloc(((size_t)mesh->vertex_count + 1) * sizeof *parent);
  PAGS_AUTOFREE uint32_t *triangles = malloc((3 * (size_t)mesh->triangle_count + 1) * sizeof *triangles);
  *out = NULL;
  *count = 0;
  PAGS_CHECK_MEMORY(parent && triangles, "%lld triangles", (long long)mesh->triangle_count);
  pags_proxy_mesh_connect(mesh, parent);
  for (int64_t v = 0; v < mesh->vertex_count; v++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh surface = {0};
    int64_t own = 0;
    if (pags_set_root(parent, v) != v)
      continue;
    for (int64_t i = 0; i < mesh->triangle_count; i++)
      if (pags_set_root(parent, mesh->triangles[3 * i]) == v)
        memcpy(triangles + 3 * own++, mesh->triangles + 3 * i, 3 * sizeof *triangles);
    if (!own)
      continue;
    PAGS_TRY(pags_proxy_mesh_copy_part(mesh, triangles, own, &surface));
    const pags_result result = cut(&surface, &list);
    if (result == PAGS_ERROR_ARGUMENT || result == PAGS_ERROR_LIMIT) /* too thin to be cut */
      PAGS_TRY(put(&list, &surface));
    else
      PAGS_TRY(result);
  }
  return PAGS_OK;
}
