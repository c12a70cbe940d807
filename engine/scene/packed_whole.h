/* SPDX-License-Identifier: Apache-2.0 */
/* Rows of packed Gaussians that are stored whole, as floats: those that would cost the others of their cluster
 * accuracy, since they lie far from them or have far larger harmonics. */
#ifndef PAGS_SCENE_PACKED_WHOLE_H
#define PAGS_SCENE_PACKED_WHOLE_H

#include <pags/packed.h>

/* Returns the rows [first, first + count), count <= PAGS_PACKED_ROWS, that are to be stored whole: bit i for row
 * first + i. */
uint64_t pags_packed_choose_whole(const pags_gaussians *g, int64_t first, int count);

/* Bytes of a whole row: its number in the cluster (uint32), then its planes of geometry and colour. */
static inline size_t pags_packed_whole_bytes(int sh_degree) {
  return sizeof(uint32_t) + (size_t)pags_plane_count(sh_degree) * sizeof(float);
}

/* Returns what there is of a cluster with whole rows, and how many these are; NULL if it has none. */
const pags_packed_mixed *pags_packed_find_mixed(const pags_packed *packed, int64_t cluster, int64_t *count);

/* Writes planes [begin, end) of a cluster's whole rows over planes of PAGS_PACKED_ROWS floats, the first being plane
 * `begin`. */
void pags_packed_put_whole(const pags_packed *packed, int64_t cluster, int begin, int end, float *planes);

/* Fails unless the lists are in order, all numbers finite, and the rows within the bounds of their clusters. */
pags_result pags_packed_check_whole(const char *path, const pags_packed *packed);

#endif
