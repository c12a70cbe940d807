/* SPDX-License-Identifier: Apache-2.0 */
#include "train/gradient_store.h"

#include <assert.h>

#include "base/memory.h"
#include "port/port.h"

bool pags_floats_renew(float **floats, int64_t count) {
  pags_port_aligned_free(*floats);
  *floats = pags_port_aligned_alloc(64, (size_t)count * sizeof(float));
  if (*floats)
    memset(*floats, 0, (size_t)count * sizeof(float));
  return *floats != NULL;
}

pags_result pags_gradient_store_reserve(pags_gradient_store *store, int64_t clusters, int64_t floats) {
  if (clusters <= store->clusters && floats <= store->floats)
    return PAGS_OK;
  pags_gradient_store_destroy(store);
  store->rows = pags_port_aligned_alloc(64, (size_t)(clusters * floats) * sizeof(float));
  store->stamp = calloc((size_t)clusters, sizeof *store->stamp);
  if (!store->rows || !store->stamp) {
    pags_gradient_store_destroy(store);
    return pags_out_of_memory("the gradients of %lld clusters", (long long)clusters);
  }
  store->clusters = clusters;
  store->floats = floats;
  return PAGS_OK;
}

void pags_gradient_store_destroy(pags_gradient_store *store) {
  pags_port_aligned_free(store->rows);
  free(store->stamp);
  *store = (pags_gradient_store){0};
}

float *pags_gradient_store_find(const pags_gradient_store *store, int64_t cluster, int64_t stamp) {
  return store->rows && store->stamp[cluster] == stamp ? store->rows + cluster * store->floats : NULL;
}

void pags_gradient_store_add(pags_gradient_store *store, int64_t cluster, int64_t stamp, const float *rows,
                             int64_t count) {
  float *const to = store->rows + cluster * store->floats;
  assert(cluster < store->clusters && count <= store->floats);
  if (store->stamp[cluster] != stamp) {
    memcpy(to, rows, (size_t)count * sizeof(float));
    store->stamp[cluster] = stamp;
    return;
  }
  for (int64_t i = 0; i < count; i++)
    to[i] += rows[i];
}
