/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/common/ranks.h"

#include "base/memory.h"

static pags_transport *transport;

pags_result pags_ranks_join(void) {
  return pags_transport_started_by_mpi() ? pags_transport_create_mpi(&transport) : PAGS_OK;
}

void pags_ranks_leave(void) {
  pags_transport_destroy(transport, false);
  transport = NULL;
}

pags_transport *pags_ranks(void) {
  return transport;
}

bool pags_ranks_lead(void) {
  return pags_transport_rank(transport) == 0;
}

bool pags_ranks_mine(int64_t item) {
  return item % pags_transport_ranks(transport) == pags_transport_rank(transport);
}

int64_t pags_ranks_tell(int64_t done, bool ends_early) {
  int64_t all;
  bool others_end;
  pags_transport_tell(transport, done, ends_early);
  pags_transport_hear(transport, &all, &others_end);
  return all > done ? all : done;
}

bool pags_ranks_stopping(void) {
  int64_t all;
  bool ends_early;
  pags_transport_hear(transport, &all, &ends_early);
  return ends_early;
}

pags_result pags_ranks_gather(const void *own, int64_t count, size_t size, void *all, int64_t *all_count) {
  const int ranks = pags_transport_ranks(transport);
  const int64_t bytes = count * (int64_t)size;
  int64_t all_bytes = 0;
  void *gathered = NULL;
  memcpy(all, &gathered, sizeof gathered);
  *all_count = 0;
  PAGS_AUTOFREE int64_t *sizes = malloc(2 * (size_t)ranks * sizeof *sizes);
  if (!sizes)
    return pags_transport_give_up(transport, pags_out_of_memory("the sizes of %d ranks", ranks));
  int64_t *const of_sizes = sizes + ranks;
  for (int rank = 0; rank < ranks; rank++)
    of_sizes[rank] = sizeof *sizes;
  pags_result result = pags_transport_gather(transport, 0, &bytes, sizeof bytes, sizes, of_sizes);
  if (result == PAGS_OK && pags_ranks_lead()) {
    for (int rank = 0; rank < ranks; rank++)
      all_bytes += sizes[rank];
    gathered = malloc((size_t)all_bytes + 1);
    if (!gathered)
      result = pags_out_of_memory("the report of %d ranks", ranks);
  }
  if (result == PAGS_OK)
    result = pags_transport_gather(transport, 0, own, bytes, gathered, sizes);
  if (result == PAGS_OK) {
    memcpy(all, &gathered, sizeof gathered);
    *all_count = all_bytes / (int64_t)size;
  } else {
    free(gathered);
  }
  return pags_transport_give_up(transport, result);
}

pags_result pags_ranks_sum(int64_t *value) {
  PAGS_AUTOFREE int64_t *all = NULL;
  int64_t count;
  PAGS_TRY(pags_ranks_gather(value, 1, sizeof *value, &all, &count));
  if (all)
    *value = 0;
  for (int64_t i = 0; i < count; i++)
    *value += all[i];
  return pags_transport_broadcast(transport, 0, value, sizeof *value);
}
