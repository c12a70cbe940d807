/* SPDX-License-Identifier: Apache-2.0 */
/* Clusters: bounds of runs of Gaussians, by which culling and picking reject a whole run at once. */
#ifndef PAGS_CLUSTERS_H
#define PAGS_CLUSTERS_H

#include <pags/gaussians.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Runs of `size` Gaussians that lie together in memory (and, if Morton-ordered, in space), with bounds that a whole run
 * can be rejected by. Bytes per Gaussian: 28 / size. */
typedef struct pags_clusters {
  int64_t count;              /* ceil(gaussians / size) */
  int size;                   /* a multiple of 16 up to 256, since kernels read whole vectors of rows; 64 by default */
  float *lo[3], *hi[3];       /* bounding box of the means */
  float *sigma;               /* largest sigma of any member */
  struct pags_clusters *runs; /* bounds of 64 clusters each, so that far more can exist than is looked at; NULL: none */
} pags_clusters;

PAGS_API pags_result pags_clusters_create(pags_clusters *clusters, int64_t gaussian_count, int size);
PAGS_API void pags_clusters_destroy(pags_clusters *clusters);
/* Adds bounds of runs of clusters, for clusters that don't change any more. */
PAGS_API pags_result pags_clusters_add_runs(pags_clusters *clusters);
PAGS_API void pags_clusters_drop_runs(pags_clusters *clusters);
/* Recomputes the bounds of clusters [first, last) from the Gaussians. */
PAGS_API void pags_clusters_update(pags_clusters *clusters, const pags_gaussians *gaussians, int64_t first,
                                   int64_t last);

#ifdef __cplusplus
}
#endif
#endif
