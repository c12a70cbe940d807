/* SPDX-License-Identifier: Apache-2.0 */
/* Fits a closed control cage of quads to a closed mesh, such that the cage's subdivision surface (Catmull and Clark
 * 1978) lies on the mesh. */
#ifndef PAGS_PROXY_CAGE_H
#define PAGS_PROXY_CAGE_H

#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* `level` 0: `out` is the cage itself; 1..3: the cage subdivided that many times, its vertices moved to the limit
 * surface. Each quad becomes two triangles, at most `budget` triangles in all (but no fewer than 12 * 4^level, a
 * cube's). */
pags_result pags_proxy_mesh_cage(const pags_proxy_mesh *mesh, int level, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
