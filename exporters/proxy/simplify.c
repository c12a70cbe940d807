/* SPDX-License-Identifier: Apache-2.0 */
/* What meshoptimizer does for meshes: decimation by edge collapses in the order of quadric errors (Garland and Heckbert
 * 1997), which keeps closed meshes closed, and the welding of vertices. */
#include <float.h>
#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/mesh.h"

#include "base/memory.h"

pags_result pags_proxy_mesh_weld(pags_proxy_mesh *mesh, double tolerance) {
  const size_t count = (size_t)mesh->vertex_count, corners = 3 * (size_t)mesh->triangle_count;
  if (!corners)
    return PAGS_OK;
  PAGS_AUTOFREE int64_t *steps = calloc(3 * count, sizeof *steps); /* positions in steps of the tolerance */
  PAGS_AUTOFREE uint32_t *place = malloc(count * sizeof *place), *first = malloc(count * sizeof *first);
  PAGS_CHECK_MEMORY(steps && place && first, "%lld vertices", (long long)count);
  for (size_t i = 0; i < 3 * count; i++)
    steps[i] = (int64_t)floor((double)mesh->positions[i] / tolerance + 0.5);
  meshopt_generateVertexRemap(place, mesh->triangles, corners, steps, count, 3 * sizeof *steps);
  for (size_t i = count; i-- > 0;)
    if (place[i] != UINT32_MAX)
      first[place[i]] = (uint32_t)i;
  for (size_t i = 0; i < corners; i++)
    mesh->triangles[i] = first[place[mesh->triangles[i]]];
  for (uint32_t *t = mesh->triangles; t < mesh->triangles + corners; t += 3)
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
      t[0] = UINT32_MAX;
  pags_proxy_mesh_drop_marked(mesh);
  return pags_proxy_mesh_compact(mesh);
}

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

pags_result pags_proxy_mesh_simplify_within(const pags_proxy_mesh *from, double error, pags_proxy_mesh *out) {
  const size_t corners = 3 * (size_t)from->triangle_count, stride = 3 * sizeof(float);
  *out = (pags_proxy_mesh){0};
  PAGS_AUTOFREE uint32_t *triangles = malloc((corners + 3) * sizeof *triangles);
  PAGS_CHECK_MEMORY(triangles, "%lld triangles", (long long)from->triangle_count);
  const double extent = (double)meshopt_simplifyScale(from->positions, (size_t)from->vertex_count, stride);
  const size_t count = meshopt_simplify(triangles, from->triangles, corners, from->positions,
                                        (size_t)from->vertex_count, stride, 0, (float)(error / extent), 0, NULL);
  return pags_proxy_mesh_copy_part(from, triangles, (int64_t)(count / 3), out);
}
