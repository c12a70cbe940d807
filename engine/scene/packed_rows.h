/* SPDX-License-Identifier: Apache-2.0 */
/* One cluster of packed Gaussians as planes of PAGS_PACKED_ROWS floats, in the planes' order of pags/gaussians.h. */
#ifndef PAGS_SCENE_PACKED_ROWS_H
#define PAGS_SCENE_PACKED_ROWS_H

#include <pags/packed.h>

enum { PAGS_PACKED_WORDS = 10, PAGS_PACKED_GEOMETRY_PLANES = PAGS_SH };

/* Means, ln sigma, rotation and logit: PAGS_SH planes. */
void pags_packed_geometry(const pags_packed *packed, int64_t cluster, float *planes);
/* The first three of these. */
void pags_packed_means(const pags_packed *packed, int64_t cluster, float *planes);
/* The colours' planes of degrees up to `sh_degree` (at most the packed one's). */
void pags_packed_colours(const pags_packed *packed, int64_t cluster, int sh_degree, float *planes);
/* s_sem of a row; 0 where it isn't known. */
float pags_packed_s_sem(const pags_packed *packed, int64_t row);

/* Where the halves end and the steps begin in a cluster's colours. */
static inline size_t pags_packed_steps_at(int sh_degree) {
  return PAGS_PACKED_ROWS * (6 + 3 * ((size_t)pags_sh_coefficients(sh_degree) - 1));
}

#define PAGS_PACKED_LOWEST (-16.0f)
#define PAGS_PACKED_STEP (32.0f / 65535.0f)       /* of ln sigma and logit */
#define PAGS_PACKED_TURN (1.41421356f / 32767.0f) /* of a quaternion's three smallest */
#define PAGS_PACKED_HALF_ROOT 0.70710678f

#endif
