/* SPDX-License-Identifier: Apache-2.0 */
/* Shares of rows, and small numbers of all ranks; see shares.h. Everybody sends to everybody, so that all ranks add up
 * the same numbers in the same order. */
#include "cluster/shares.h"

#include "base/memory.h"

void pags_shares_cut(const int64_t *rows, int64_t models, int cluster, int ranks, int64_t *begin) {
  int64_t all = 0, at = 0;
  for (int64_t m = 0; m < models; m++)
    all += rows[m];
  for (int64_t m = 0; m < models; m++) {
    int64_t *const cuts = begin + m * (ranks + 1);
    for (int r = 0; r <= ranks; r++) {
      const int64_t even = all / ranks * r + all % ranks * r / ranks - at;
      const int64_t cut = even < 0 ? 0 : even > rows[m] ? rows[m] : even;
      const bool end = r == ranks || cut == rows[m];
      cuts[r] = end ? rows[m] : m == 0 ? cut / cluster * cluster : 2 * cut < rows[m] ? 0 : rows[m];
    }
    cuts[0] = 0;
    at += rows[m];
  }
}

pags_result pags_share_parts(pags_transport *transport, const void *mine, int64_t bytes, void **all,
                             int64_t *bytes_of) {
  const int ranks = pags_transport_ranks(transport);
  *all = NULL;
  PAGS_TRY(pags_share_all(transport, &bytes, sizeof bytes, bytes_of));
  int64_t sum = 0;
  for (int r = 0; r < ranks; r++)
    sum += bytes_of[r];
  PAGS_AUTOFREE int64_t *sent = malloc((size_t)ranks * sizeof *sent);
  PAGS_AUTOFREE char *copies = malloc((size_t)(bytes * ranks + 1));
  PAGS_AUTOFREE char *arrived = malloc((size_t)sum + 1);
  const bool room = sent && copies && arrived;
  PAGS_TRY(pags_transport_agree(transport, room ? PAGS_OK : pags_out_of_memory("a message to %d ranks", ranks)));
  for (int r = 0; r < ranks; r++) {
    sent[r] = bytes;
    if (bytes > 0)
      memcpy(copies + r * bytes, mine, (size_t)bytes);
  }
  PAGS_TRY(pags_transport_exchange(transport, copies, sent, arrived, bytes_of));
  *all = pags_take(&arrived);
  return PAGS_OK;
}

pags_result pags_share_all(pags_transport *transport, const void *mine, int64_t bytes, void *all) {
  const int ranks = pags_transport_ranks(transport);
  PAGS_AUTOFREE char *copies = malloc((size_t)(bytes * ranks + 1));
  if (!copies)
    return pags_transport_give_up(transport, pags_out_of_memory("a message to %d ranks", ranks));
  for (int r = 0; r < ranks; r++)
    memcpy(copies + r * bytes, mine, (size_t)bytes);
  return pags_share_each(transport, copies, all, bytes);
}

pags_result pags_share_sum(pags_transport *transport, int64_t *numbers, int count) {
  const int ranks = pags_transport_ranks(transport);
  if (ranks == 1 || count == 0)
    return PAGS_OK;
  PAGS_AUTOFREE int64_t *all = malloc((size_t)ranks * (size_t)count * sizeof *all);
  if (!all)
    return pags_transport_give_up(transport, pags_out_of_memory("%d numbers of %d ranks", count, ranks));
  PAGS_TRY(pags_share_all(transport, numbers, count * (int64_t)sizeof *numbers, all));
  for (int i = 0; i < count; i++) {
    numbers[i] = 0;
    for (int r = 0; r < ranks; r++)
      numbers[i] += all[r * count + i];
  }
  return PAGS_OK;
}

pags_result pags_share_before(pags_transport *transport, int64_t number, int64_t *before, int64_t *all) {
  const int ranks = pags_transport_ranks(transport), rank = pags_transport_rank(transport);
  PAGS_AUTOFREE int64_t *numbers = malloc((size_t)ranks * sizeof *numbers);
  if (!numbers)
    return pags_transport_give_up(transport, pags_out_of_memory("the numbers of %d ranks", ranks));
  *before = *all = 0;
  PAGS_TRY(pags_share_all(transport, &number, sizeof number, numbers));
  for (int r = 0; r < ranks; r++) {
    *before += r < rank ? numbers[r] : 0;
    *all += numbers[r];
  }
  return PAGS_OK;
}

pags_result pags_share_each(pags_transport *transport, const void *send, void *receive, int64_t bytes) {
  const int ranks = pags_transport_ranks(transport);
  PAGS_AUTOFREE int64_t *counts = malloc((size_t)ranks * sizeof *counts);
  if (!counts)
    return pags_transport_give_up(transport, pags_out_of_memory("a message to %d ranks", ranks));
  for (int r = 0; r < ranks; r++)
    counts[r] = bytes;
  return pags_transport_exchange(transport, send, counts, receive, counts);
}

pags_result pags_share_items(pags_transport *transport, const void *send, const int64_t *sent, void *receive,
                             const int64_t *received, int64_t bytes) {
  const int ranks = pags_transport_ranks(transport);
  PAGS_AUTOFREE int64_t *counts = malloc(2 * (size_t)ranks * sizeof *counts);
  if (!counts)
    return pags_transport_give_up(transport, pags_out_of_memory("a message to %d ranks", ranks));
  for (int r = 0; r < ranks; r++) {
    counts[r] = sent[r] * bytes;
    counts[ranks + r] = received[r] * bytes;
  }
  return pags_transport_exchange(transport, send, counts, receive, counts + ranks);
}
