/* Bounds of runs of Gaussians. */
#include <math.h>
#include <pags/frame.h>
#include <stdlib.h>
#include <string.h>

enum { BOUND_PLANES = 7 };

pags_result pags_clusters_create(pags_clusters *clusters, int64_t gaussian_count, int size) {
  memset(clusters, 0, sizeof *clusters);
  if (size < 1 || size > 256 || (size > 1 && size % 16 != 0))
    return pags_fail(PAGS_ERROR_ARGUMENT, "cluster size %d: expected 1 or a multiple of 16 up to 256", size);
  clusters->size = size;
  clusters->count = (gaussian_count + size - 1) / size;
  if (clusters->count == 0)
    return PAGS_OK;
  float *const data = calloc((size_t)clusters->count, BOUND_PLANES * sizeof(float));
  if (!data)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for the bounds of %lld clusters", (long long)clusters->count);
  for (int k = 0; k < 3; k++) {
    clusters->lo[k] = data + k * clusters->count;
    clusters->hi[k] = data + (3 + k) * clusters->count;
  }
  clusters->sigma = data + 6 * clusters->count;
  return PAGS_OK;
}

void pags_clusters_destroy(pags_clusters *clusters) {
  free(clusters->lo[0]);
  memset(clusters, 0, sizeof *clusters);
}

void pags_clusters_update(pags_clusters *clusters, const pags_gaussians *gaussians, int64_t first, int64_t last) {
  for (int64_t c = first; c < last; c++) {
    const int64_t begin = c * clusters->size;
    const int64_t end = begin + clusters->size < gaussians->count ? begin + clusters->size : gaussians->count;
    float largest = -INFINITY;
    for (int k = 0; k < 3; k++) {
      const float *const mean = pags_plane(gaussians, PAGS_MEAN + k), *const scale = pags_plane(gaussians, PAGS_SCALE + k);
      float lo = INFINITY, hi = -INFINITY;
      for (int64_t i = begin; i < end; i++) {
        lo = mean[i] < lo ? mean[i] : lo;
        hi = mean[i] > hi ? mean[i] : hi;
        largest = scale[i] > largest ? scale[i] : largest;
      }
      clusters->lo[k][c] = lo;
      clusters->hi[k][c] = hi;
    }
    /* A hair more than exp of the largest, since the projection kernel's exp rounds otherwise than libm's. */
    clusters->sigma[c] = expf(largest) * 1.00001f;
  }
}
