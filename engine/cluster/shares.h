/* SPDX-License-Identifier: Apache-2.0 */
/* Who owns which rows, and small numbers of all ranks. Collective functions (cluster/transport.h) unless said
 * otherwise. */
#ifndef PAGS_CLUSTER_SHARES_H
#define PAGS_CLUSTER_SHARES_H

#include "cluster/transport.h"

/* Shares out the rows of `models` models of rows[] rows each, as even as it can be done: model m's rows [begin[m *
 * (ranks + 1) + r], begin[m * (ranks + 1) + r + 1]) belong to rank r. All rows, model after model, are cut into equal
 * lengths; a cut in model 0, the background, moves to a multiple of `cluster` rows, a cut in another model, of a moving
 * object, to its nearer end: a whole object has one owner. Not collective. */
void pags_shares_cut(const int64_t *rows, int64_t models, int cluster, int ranks, int64_t *begin);

/* Replaces each of `count` numbers by its sum over all ranks. */
pags_result pags_share_sum(pags_transport *transport, int64_t *numbers, int count);
/* Sum of the numbers of the ranks before this one, and of all. */
pags_result pags_share_before(pags_transport *transport, int64_t number, int64_t *before, int64_t *all);
/* Gives every rank the `bytes` of all, in the order of the ranks: `all` holds bytes * ranks. */
pags_result pags_share_all(pags_transport *transport, const void *mine, int64_t bytes, void *all);
/* The same of parts of different lengths; *all, which the caller frees, receives them, bytes_of[rank] each. */
pags_result pags_share_parts(pags_transport *transport, const void *mine, int64_t bytes, void **all, int64_t *bytes_of);

/* Exchanges one item of `bytes` with every rank, in the order of the ranks. */
pags_result pags_share_each(pags_transport *transport, const void *send, void *receive, int64_t bytes);
/* Exchanges items of `bytes` each: sent[rank] to every rank, received[rank] from it, in the order of the ranks. */
pags_result pags_share_items(pags_transport *transport, const void *send, const int64_t *sent, void *receive,
                             const int64_t *received, int64_t bytes);

#endif
