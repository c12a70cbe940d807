/* SPDX-License-Identifier: Apache-2.0 */
/* Catmull-Clark subdivision of closed quad meshes, through OpenSubdiv. */
#ifndef PAGS_PROXY_SUBDIV_H
#define PAGS_PROXY_SUBDIV_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Stencils of the limit surface, which express its points as weighted sums of control points: point i is the sum, for
 * j from first[i] up to first[i + 1], of weights[j] times control point indices[j]. */
typedef struct pags_stencils {
  int64_t count;
  int64_t *first; /* count + 1 */
  int32_t *indices;
  float *weights;
} pags_stencils;

void pags_stencils_destroy(pags_stencils *stencils); /* frees and zeroes */

typedef struct pags_quads {
  int vertex_count, quad_count;
  float *positions; /* 3 a vertex */
  int *quads;       /* 4 vertices each */
} pags_quads;

void pags_quads_destroy(pags_quads *quads); /* frees and zeroes */

/* Makes the stencils of side x side points of the limit surface on each quad, at the quad's parameters
 * ((i + 0.5) / side, (j + 0.5) / side) for i and j in 0..side - 1. */
pags_result pags_subdiv_stencils(const pags_quads *mesh, int side, pags_stencils *out);

/* Subdivides the mesh `level` >= 1 times and moves the vertices onto the limit surface. For both: the caller destroys
 * `out`, also after a failure. */
pags_result pags_subdiv_refine(const pags_quads *mesh, int level, pags_quads *out);

#ifdef __cplusplus
}
#endif
#endif
