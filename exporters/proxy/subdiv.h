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

/* Makes the stencils of side x side points of the limit surface on each quad, at the quad's parameters
 * ((i + 0.5) / side, (j + 0.5) / side) for i and j in 0..side - 1. */
pags_result pags_subdiv_stencils(int vertex_count, int quad_count, const int *quads, int side, pags_stencils *out);

/* Subdivides the mesh `level` >= 1 times and moves the vertices onto the limit surface. The caller frees both
 * arrays. */
pags_result pags_subdiv_refine(int vertex_count, const float *positions, int quad_count, const int *quads, int level,
                               int *out_vertex_count, float **out_positions, int *out_quad_count, int **out_quads);

#ifdef __cplusplus
}
#endif
#endif
