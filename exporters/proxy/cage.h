/* SPDX-License-Identifier: Apache-2.0 */
/* A closed quad control cage whose subdivision surface (Catmull and Clark 1978) follows a closed mesh. */
#ifndef PAGS_PROXY_CAGE_H
#define PAGS_PROXY_CAGE_H

#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* `level` 0: the cage itself; 1..3: subdivided so often, vertices on the limit surface. Quads are written as two
 * triangles, at most `budget` of them (but no fewer than 12). */
pags_result pags_proxy_mesh_cage(const pags_proxy_mesh *mesh, int level, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
