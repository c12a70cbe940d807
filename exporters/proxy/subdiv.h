/* SPDX-License-Identifier: Apache-2.0 */
/* Catmull-Clark subdivision of closed quad meshes, through OpenSubdiv. */
#ifndef PAGS_PROXY_SUBDIV_H
#define PAGS_PROXY_SUBDIV_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Points of the limit surface as weighted sums of control points: point i is the sum over k of weights[first[i] + k]
 * times control point indices[first[i] + k]. */
typedef struct pags_stencils {
  int64_t count;
  int64_t *first; /* count + 1 */
  int32_t *indices;
  float *weights;
} pags_stencils;

void pags_stencils_destroy(pags_stencils *stencils); /* frees and zeroes */

/* side x side points on each quad, at ((i + 0.5) / side, (j + 0.5) / side). */
pags_result pags_subdiv_stencils(int vertex_count, int quad_count, const int *quads, int side, pags_stencils *out);

/* The mesh after `level` >= 1 subdivisions, its vertices moved onto the limit surface. Both arrays are freed by the
 * caller. */
pags_result pags_subdiv_refine(int vertex_count, const float *positions, int quad_count, const int *quads, int level,
                               int *out_vertex_count, float **out_positions, int *out_quad_count, int **out_quads);

#ifdef __cplusplus
}
#endif
#endif
