/* SPDX-License-Identifier: Apache-2.0 */
/* Gradients of a model's Gaussians, kept cluster by cluster until they are used later in a step; memory for vectors. */
#ifndef PAGS_TRAIN_GRADIENT_STORE_H
#define PAGS_TRAIN_GRADIENT_STORE_H

#include <stdbool.h>

#include <pags/base.h>

/* Frees *floats and replaces it by `count` zeros, aligned to 64 bytes; `count` is a multiple of 16. False, with *floats
 * NULL, if out of memory. */
bool pags_floats_renew(float **floats, int64_t count);
typedef struct pags_gradient_store {
  float *rows;    /* [clusters][floats]: the planes of each cluster's rows, as the frame gives them */
  int64_t *stamp; /* per cluster: what its rows belong to, a number >= 1 that the user counts up; 0: nothing yet */
  int64_t clusters, floats;
} pags_gradient_store;

/* Makes room for `clusters` of `floats` each; the contents are lost if the store grows. PAGS_ERROR_MEMORY. */
pags_result pags_gradient_store_reserve(pags_gradient_store *store, int64_t clusters, int64_t floats);
void pags_gradient_store_destroy(pags_gradient_store *store);

/* The rows of a cluster if they belong to `stamp`, else NULL; NULL for a store without room. */
float *pags_gradient_store_find(const pags_gradient_store *store, int64_t cluster, int64_t stamp);
/* Adds `count` floats to a cluster's rows; those of another stamp are replaced. Threads may add to different
 * clusters at the same time. */
void pags_gradient_store_add(pags_gradient_store *store, int64_t cluster, int64_t stamp, const float *rows,
                             int64_t count);

#endif
