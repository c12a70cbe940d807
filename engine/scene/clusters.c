/* SPDX-License-Identifier: Apache-2.0 */
/* Bounds of clusters (pags/clusters.h): for each run of consecutive Gaussians the box of its means and its largest
 * sigma, in seven planes of floats, and the same for runs of 64 clusters. */
#include <math.h>
#include <pags/clusters.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "maths/maths.h"

enum {
  BOUND_PLANES = 7, /* lo x y z, hi x y z, sigma */
  RUN = 64          /* clusters of a run */
};

/* Allocates and zeroes the bounds of `count` clusters of `size` Gaussians, in one block that begins at lo[0]. */
static pags_result allocate(pags_clusters *clusters, int64_t count, int size) {
  clusters->size = size;
  clusters->count = count;
  if (count == 0)
    return PAGS_OK;
  float *const data = calloc((size_t)clusters->count, BOUND_PLANES * sizeof(float));
  PAGS_CHECK_MEMORY(data, "the bounds of %lld clusters", (long long)clusters->count);
  for (int k = 0; k < 3; k++) {
    clusters->lo[k] = data + k * clusters->count;
    clusters->hi[k] = data + (3 + k) * clusters->count;
  }
  clusters->sigma = data + 6 * clusters->count;
  return PAGS_OK;
}

pags_result pags_clusters_create(pags_clusters *clusters, int64_t gaussian_count, int size) {
  memset(clusters, 0, sizeof *clusters);
  if (size < 16 || size > PAGS_LARGEST_CLUSTER || size % 16 != 0)
    return pags_fail(PAGS_ERROR_ARGUMENT, "cluster size %d: expected a multiple of 16 up to %d", size,
                     PAGS_LARGEST_CLUSTER);
  return allocate(clusters, (gaussian_count + size - 1) / size, size);
}

void pags_clusters_drop_runs(pags_clusters *clusters) {
  if (clusters->runs)
    free(clusters->runs->lo[0]);
  free(clusters->runs);
  clusters->runs = NULL;
}

pags_result pags_clusters_add_runs(pags_clusters *clusters) {
  PAGS_AUTOFREE pags_clusters *runs = calloc(1, sizeof *runs);
  PAGS_CHECK_MEMORY(runs && allocate(runs, (clusters->count + RUN - 1) / RUN, RUN * clusters->size) == PAGS_OK,
                    "the bounds of %lld clusters", (long long)clusters->count);
  for (int64_t r = 0; r < runs->count; r++) {
    const int64_t begin = r * RUN, end = begin + RUN < clusters->count ? begin + RUN : clusters->count;
    runs->sigma[r] = 0.0f;
    for (int64_t i = begin; i < end; i++) {
      for (int k = 0; k < 3; k++) {
        runs->lo[k][r] = i == begin ? clusters->lo[k][i] : fminf(runs->lo[k][r], clusters->lo[k][i]);
        runs->hi[k][r] = i == begin ? clusters->hi[k][i] : fmaxf(runs->hi[k][r], clusters->hi[k][i]);
      }
      runs->sigma[r] = fmaxf(runs->sigma[r], clusters->sigma[i]);
    }
  }
  pags_clusters_drop_runs(clusters);
  clusters->runs = pags_take(&runs);
  return PAGS_OK;
}

void pags_clusters_destroy(pags_clusters *clusters) {
  pags_clusters_drop_runs(clusters);
  free(clusters->lo[0]);
  memset(clusters, 0, sizeof *clusters);
}

void pags_clusters_update(pags_clusters *clusters, const pags_gaussians *gaussians, int64_t first, int64_t last) {
  for (int64_t c = first; c < last; c++) {
    const int64_t begin = c * clusters->size;
    const int64_t end = begin + clusters->size < gaussians->count ? begin + clusters->size : gaussians->count;
    float largest = -INFINITY;
    for (int k = 0; k < 3; k++) {
      const float *const mean = pags_plane(gaussians, PAGS_MEAN + k), *const scale =
                                                                          pags_plane(gaussians, PAGS_SCALE + k);
      float lo = INFINITY, hi = -INFINITY;
      for (int64_t i = begin; i < end; i++) {
        lo = mean[i] < lo ? mean[i] : lo;
        hi = mean[i] > hi ? mean[i] : hi;
        largest = scale[i] > largest ? scale[i] : largest;
      }
      clusters->lo[k][c] = lo;
      clusters->hi[k][c] = hi;
    }
    /* One part in 1e5 is added because the exp of the projection kernel rounds differently from that of libm. */
    clusters->sigma[c] = pags_expf(largest) * 1.00001f;
  }
}
