/* SPDX-License-Identifier: Apache-2.0 */
/* Decimates a mesh by meshoptimizer's edge collapses in the order of quadric errors (Garland and Heckbert 1997), and
 * keeps closed meshes closed. */
#include <float.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/mesh.h"

#include "base/memory.h"

pags_result pags_proxy_mesh_simplify(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out) {
  static const double shares[] = {1, 0.97, 0.9, 0.8, 0.65, 0.5, 0.35, 0.25};
  const size_t corners = 3 * (size_t)from->triangle_count;
  pags_proxy_mesh_topology before, after;
  *out = (pags_proxy_mesh){0};
  if (from->triangle_count <= budget)
    return pags_proxy_mesh_copy(from, out);
  PAGS_TRY(pags_proxy_mesh_inspect(from, &before));
  PAGS_AUTOFREE uint32_t *triangles = malloc((corners + 3) * sizeof *triangles);
  PAGS_CHECK_MEMORY(triangles, "%lld triangles", (long long)from->triangle_count);
  for (size_t i = 0; i < sizeof shares / sizeof shares[0]; i++) {
    /* Decimate once, to this share of the budget if collapses that keep the topology allow it. */
    const int64_t target = (int64_t)((double)budget * shares[i]);
    const size_t count =
        meshopt_simplify(triangles, from->triangles, corners, from->positions, (size_t)from->vertex_count,
                         3 * sizeof(float), 3 * (size_t)target, FLT_MAX, 0, NULL);
    PAGS_TRY(pags_proxy_mesh_copy_part(from, triangles, (int64_t)(count / 3), out));
    if (before.closed)
      PAGS_TRY(pags_proxy_mesh_repair(out));
    PAGS_TRY(pags_proxy_mesh_inspect(out, &after));
    if (out->triangle_count > 0 && out->triangle_count <= budget && (!before.closed || after.closed))
      return PAGS_OK;
    pags_proxy_mesh_destroy(out);
  }
  return pags_fail(PAGS_ERROR_LIMIT, "a mesh of %lld triangles can't be brought to %lld: %lld open edges, %lld crossed",
                   (long long)from->triangle_count, (long long)budget, (long long)after.open_edges,
                   (long long)after.crossed_edges);
}
