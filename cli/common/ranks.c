/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/common/ranks.h"

#include <stdlib.h>

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

pags_result pags_ranks_gather(const void *own, int64_t bytes, void **all, int64_t *all_bytes) {
  const int ranks = pags_transport_ranks(transport);
  *all = NULL;
  *all_bytes = 0;
  int64_t *sizes = malloc(2 * (size_t)ranks * sizeof *sizes);
  if (!sizes)
    return pags_transport_give_up(transport, pags_out_of_memory("the sizes of %d ranks", ranks));
  int64_t *const of_sizes = sizes + ranks;
  for (int rank = 0; rank < ranks; rank++)
    of_sizes[rank] = sizeof *sizes;
  pags_result result = pags_transport_gather(transport, 0, &bytes, sizeof bytes, sizes, of_sizes);
  if (result == PAGS_OK && pags_ranks_lead()) {
    for (int rank = 0; rank < ranks; rank++)
      *all_bytes += sizes[rank];
    *all = malloc((size_t)*all_bytes + 1);
    if (!*all)
      result = pags_out_of_memory("the report of %d ranks", ranks);
  }
  if (result == PAGS_OK)
    result = pags_transport_gather(transport, 0, own, bytes, *all, sizes);
  free(sizes);
  if (result != PAGS_OK) {
    free(*all);
    *all = NULL;
  }
  return pags_transport_give_up(transport, result);
}

pags_result pags_ranks_sum(int64_t *value) {
  void *all;
  int64_t bytes;
  PAGS_TRY(pags_ranks_gather(value, sizeof *value, &all, &bytes));
  if (all)
    *value = 0;
  if (all)
    for (int64_t i = 0; i < bytes / (int64_t)sizeof *value; i++)
      *value += ((int64_t *)all)[i];
  free(all);
  return pags_transport_broadcast(transport, 0, value, sizeof *value);
}
