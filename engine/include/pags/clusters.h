/* SPDX-License-Identifier: Apache-2.0 */
/* Clusters: runs of Gaussians that follow each other in memory, each with a bounding box of its means and its
 * largest sigma. Culling and picking reject a whole cluster by these bounds without reading its Gaussians. */
#ifndef PAGS_CLUSTERS_H
#define PAGS_CLUSTERS_H

#include <pags/gaussians.h>

PAGS_BEGIN_C

/* Gaussians in the largest clusters. */
enum { PAGS_LARGEST_CLUSTER = 256 };

/* The bounds of all clusters of a set of Gaussians. Cluster c holds the rows [c * size, (c + 1) * size); the last
 * cluster may be shorter. The bounds are tight if the rows are in Morton order (pags_gaussians_morton_order),
 * since rows that lie together in memory then lie together in space too. Memory: 28 / size bytes per Gaussian. */
typedef struct pags_clusters {
  int64_t count; /* number of clusters: ceil(Gaussians / size) */
  /* Gaussians per cluster: a multiple of 16 from 16 to 256, since kernels read whole vectors of rows. 64 is
   * usual. */
  int size;
  float *lo[3], *hi[3]; /* per axis and cluster: bounding box of the means, metres, in the Gaussians' own frame */
  float *sigma;         /* per cluster: largest sigma of any member, metres, rounded up by 1e-5 of itself */
  /* A second level: the bounds of runs of 64 clusters each, by which 64 clusters are rejected at once, so that
   * scenes may have far more clusters than a frame has to test. NULL: there is no second level. */
  struct pags_clusters *runs;
} pags_clusters;

/* Allocates bounds, all zero, for `gaussian_count` Gaussians in clusters of `size`; `clusters` is overwritten.
 * Call pags_clusters_update to compute the bounds. PAGS_ERROR_ARGUMENT for a size that isn't a multiple of 16 in
 * 16..256; PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_clusters_create(pags_clusters *clusters, int64_t gaussian_count, int size);

/* Frees the bounds and the second level and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_clusters_destroy(pags_clusters *clusters);

/* Computes the second level (`runs`) from the present bounds and replaces an earlier one. pags_clusters_update
 * doesn't keep the second level up to date: only add it once the bounds no longer change. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_clusters_add_runs(pags_clusters *clusters);

/* Frees the second level and sets `runs` to NULL. */
PAGS_API void pags_clusters_drop_runs(pags_clusters *clusters);

/* Recomputes the bounds of the clusters [first, last) from the means and scales of `gaussians`, which must have
 * the number of rows that `clusters` was created for. Threads may update disjoint ranges at the same time. */
PAGS_API void pags_clusters_update(pags_clusters *clusters, const pags_gaussians *gaussians, int64_t first,
                                   int64_t last);

PAGS_END_C
#endif
