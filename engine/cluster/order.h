/* SPDX-License-Identifier: Apache-2.0 */
/* One sorted order of items that are spread over ranks, equal to sorting all of them in one place. All functions are
 * collective (cluster/transport.h); with one rank, whose transport is NULL, they are the serial ones.
 *
 * An item is its key; the keys of all ranks are distinct, which a number of the item in the low half sees to. Whatever
 * else belongs to an item travels by pags_order_move, in either direction. */
#ifndef PAGS_CLUSTER_ORDER_H
#define PAGS_CLUSTER_ORDER_H

#include "cluster/transport.h"

/* Compared by high, then by low. */
typedef struct pags_key {
  uint64_t high, low;
} pags_key;

static inline bool pags_key_less(pags_key a, pags_key b) {
  return a.high != b.high ? a.high < b.high : a.low < b.low;
}
/* Bits whose order as a whole number is that of the value; none may be NaN. 0 and -0 are equal, as in a comparison. */
uint64_t pags_key_of_double(double value);
uint64_t pags_key_of_float(float value);
double pags_double_of_key(uint64_t bits);

/* Sorts keys in ascending order. PAGS_ERROR_MEMORY. */
pags_result pags_keys_sort(pags_key *keys, int64_t count);

/* Finds the items at `positions` (0 is the least of all ranks', the same numbers at every rank): keys[i] receives the
 * key of which exactly positions[i] are less; both halves UINT64_MAX for a position behind the last item. `sorted`:
 * this rank's own keys in ascending order. */
pags_result pags_order_find(pags_transport *transport, const pags_key *sorted, int64_t count, const int64_t *positions,
                            int found, pags_key *keys);

/* The part of the order that lies at this rank. */
typedef struct pags_spread_order {
  int64_t first, count; /* the positions [first, first + count) */
  pags_key *keys;       /* [count] */
  int64_t own;          /* items that this rank had */
  /* sent: indices of this rank's items in sending order, by receiving rank; arrived: for each position of the final
   * order, the index of its item in the receive buffer. Below, their numbers per rank. */
  uint32_t *sent, *arrived;
  int64_t *sent_items, *arrived_items; /* [ranks] */
} pags_spread_order;

/* Sorts this rank's `count` keys (at most 2^32) with those of all others; rank r receives the positions from cuts[r] up
 * to cuts[r + 1]; cuts[0] is 0, cuts[ranks] the number of all items. The order is freed by pags_order_destroy, after a
 * failure, too. */
pags_result pags_order_create(pags_transport *transport, const pags_key *keys, int64_t count, const int64_t *cuts,
                              pags_spread_order *order);
/* The same with cuts that give every rank as many items. */
pags_result pags_order_create_even(pags_transport *transport, const pags_key *keys, int64_t count,
                                   pags_spread_order *order);
void pags_order_destroy(pags_spread_order *order);

/* Moves a value of four bytes of every item: from the rank that had it, own[index], to its place in the order,
 * placed[position - first]; `back`: the other way. */
pags_result pags_order_move(pags_transport *transport, const pags_spread_order *order, void *own, void *placed,
                            bool back);

#endif
