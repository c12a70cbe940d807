/* SPDX-License-Identifier: Apache-2.0 */
/* The clusters of packed Gaussians: unpacks one into planes of PAGS_PACKED_ROWS floats, in the order of planes of
 * pags/gaussians.h; the constants of the quantisation; and whole rows, which are stored as floats because they would
 * cost the others of their cluster accuracy: they lie far away or have far larger harmonics. */
#ifndef PAGS_SCENE_PACKED_ROWS_H
#define PAGS_SCENE_PACKED_ROWS_H

#include <pags/packed.h>

enum {
  PAGS_PACKED_WORDS = 10,               /* 16-bit words of geometry per Gaussian */
  PAGS_PACKED_GEOMETRY_PLANES = PAGS_SH /* planes of floats that they unpack to */
};

/* Unpacks the means, ln sigma, rotations and opacity logits of a cluster, the planes 0 to PAGS_SH - 1. */
void pags_packed_geometry(const pags_packed *packed, int64_t cluster, float *planes);
/* Unpacks only the means: three planes. */
void pags_packed_means(const pags_packed *packed, int64_t cluster, float *planes);
/* Unpacks the SH planes of degrees 0 to `sh_degree`, which must not exceed the degree that is packed. */
void pags_packed_colours(const pags_packed *packed, int64_t cluster, int sh_degree, float *planes);
/* Returns the semantic priority (0..1) of Gaussian `row`; 0 if the file has none. */
float pags_packed_s_sem(const pags_packed *packed, int64_t row);

/* Returns the byte offset, in a cluster's block of colours, of the floats that give the quantisation step of each
 * plane; half floats and int8 coefficients come before them. */
static inline size_t pags_packed_steps_at(int sh_degree) {
  return PAGS_PACKED_ROWS * (6 + 3 * ((size_t)pags_sh_coefficients(sh_degree) - 1));
}

#define PAGS_PACKED_LOWEST (-16.0f)               /* smallest ln sigma and opacity logit */
#define PAGS_PACKED_STEP (32.0f / 65535.0f)       /* quantisation step of ln sigma and of the opacity logit */
#define PAGS_PACKED_TURN (1.41421356f / 32767.0f) /* quantisation step of a quaternion's three smaller components */
#define PAGS_PACKED_HALF_ROOT 0.70710678f         /* sqrt(1/2), the largest value that these can have */

/* Returns the rows [first, first + count), count <= PAGS_PACKED_ROWS, that are to be stored whole: bit i for row
 * first + i. */
uint64_t pags_packed_choose_whole(const pags_gaussians *g, int64_t first, int count);

/* Bytes of a whole row: its number in the cluster (uint32), then its planes of geometry and colour. */
static inline size_t pags_packed_whole_bytes(int sh_degree) {
  return sizeof(uint32_t) + (size_t)pags_plane_count(sh_degree) * sizeof(float);
}

/* Returns what there is of a cluster with whole rows, and how many these are; NULL if it has none. */
const pags_packed_mixed *pags_packed_find_mixed(const pags_packed *packed, int64_t cluster, int64_t *count);

/* Fails unless the lists are in order, all numbers finite, and the rows within the bounds of their clusters. */
pags_result pags_packed_check_whole(const char *path, const pags_packed *packed);

#endif
