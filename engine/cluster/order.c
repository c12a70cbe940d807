/* SPDX-License-Identifier: Apache-2.0 */
/* A sample sort without samples: each rank sorts its own keys; the keys at the ranks' cuts are found exactly, digit by
 * digit, from the number of smaller keys at all ranks; then every item goes to the rank of its position. The digits of
 * a cut's key are found from the highest on, one exchange of counts each, since the number of keys below any bound is a
 * binary search in a sorted list. */
#include "cluster/order.h"
#include "base/memory.h"
#include "cluster/shares.h"

/* ---- Keys ---- */

static const uint64_t sign = UINT64_C(1) << 63;

uint64_t pags_key_of_double(double value) {
  uint64_t bits;
  value = value == 0.0 ? 0.0 : value;
  memcpy(&bits, &value, sizeof bits);
  return bits & sign ? ~bits : bits | sign;
}

uint64_t pags_key_of_float(float value) {
  return pags_key_of_double((double)value);
}

double pags_double_of_key(uint64_t bits) {
  double value;
  bits = bits & sign ? bits & ~sign : ~bits;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* Number of keys below `bound`. */
static int64_t count_below(const pags_key *sorted, int64_t count, pags_key bound) {
  int64_t lo = 0, hi = count;
  while (lo < hi) {
    const int64_t middle = lo + (hi - lo) / 2;
    if (pags_key_less(sorted[middle], bound))
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo;
}

/* ---- Sorting at one rank ---- */

typedef struct numbered_key {
  pags_key key;
  uint32_t number;
} numbered_key;

enum { DIGITS = 16 }; /* bytes of a key */

static unsigned digit_of(pags_key key, int digit) {
  return (unsigned)((digit < 8 ? key.low : key.high) >> digit % 8 * 8 & 255);
}

/* Radix sort by bytes, the lowest first; those that all keys share are left out. Returns the block that holds the
 * result: `items` or `spare`. */
static numbered_key *sort_numbered(numbered_key *items, numbered_key *spare, int64_t count) {
  for (int digit = 0; digit < DIGITS; digit++) {
    int64_t place[257] = {0};
    for (int64_t i = 0; i < count; i++)
      place[1 + digit_of(items[i].key, digit)]++;
    if (count == 0 || place[1 + digit_of(items[0].key, digit)] == count)
      continue;
    for (int d = 0; d < 256; d++)
      place[d + 1] += place[d];
    for (int64_t i = 0; i < count; i++)
      spare[place[digit_of(items[i].key, digit)]++] = items[i];
    numbered_key *const swap = items;
    items = spare;
    spare = swap;
  }
  return items;
}

/* Sorts the keys; `numbers`, unless NULL, receives the former index of each. */
static pags_result sort_keys(pags_key *keys, int64_t count, uint32_t *numbers) {
  PAGS_AUTOFREE numbered_key *block = malloc((size_t)(2 * count + 1) * sizeof *block);
  PAGS_CHECK_MEMORY(block, "an order of %lld items", (long long)count);
  for (int64_t i = 0; i < count; i++)
    block[i] = (numbered_key){keys[i], (uint32_t)i};
  const numbered_key *const sorted = sort_numbered(block, block + count, count);
  for (int64_t i = 0; i < count; i++) {
    keys[i] = sorted[i].key;
    if (numbers)
      numbers[i] = sorted[i].number;
  }
  return PAGS_OK;
}

pags_result pags_keys_sort(pags_key *keys, int64_t count) {
  return sort_keys(keys, count, NULL);
}

/* ---- Items at given positions ---- */

static pags_key with_digit(pags_key key, int bit, int digit) {
  *(bit < 64 ? &key.low : &key.high) |= (uint64_t)digit << bit % 64;
  return key;
}

pags_result pags_order_find(pags_transport *transport, const pags_key *sorted, int64_t count, const int64_t *positions,
                            int found, pags_key *keys) {
  const int bits = found <= 8 ? 8 : 4, bounds = (1 << bits) - 1; /* of a round: fewer where there are many positions */
  PAGS_AUTOFREE int64_t *below = malloc((size_t)(found * bounds + 1) * sizeof *below);
  int64_t all = count;
  if (!below)
    return pags_transport_give_up(transport, pags_out_of_memory("%d positions", found));
  PAGS_TRY(pags_share_sum(transport, &all, 1));
  for (int i = 0; i < found; i++)
    keys[i] = (pags_key){0, 0};

  /* The key at a position is the largest bound that has at most that many keys below it, unless that is behind all. */
  for (int bit = 128 - bits; bit >= 0; bit -= bits) {
    for (int i = 0; i < found; i++)
      for (int digit = 1; digit <= bounds; digit++)
        below[i * bounds + digit - 1] = count_below(sorted, count, with_digit(keys[i], bit, digit));
    PAGS_TRY(pags_share_sum(transport, below, found * bounds));
    for (int i = 0; i < found; i++) {
      int digit = bounds;
      while (digit > 0 && positions[i] < all && below[i * bounds + digit - 1] > positions[i])
        digit--;
      keys[i] = with_digit(keys[i], bit, digit);
    }
  }
  return PAGS_OK;
}

/* ---- The whole order ---- */

/* Fills sent_items: own keys, which are sorted, up to each cut. */
static pags_result cut_keys(pags_transport *transport, const pags_key *sorted, const int64_t *cuts,
                            pags_spread_order *order) {
  const int ranks = pags_transport_ranks(transport);
  PAGS_AUTOFREE pags_key *bounds = malloc((size_t)(ranks + 1) * sizeof *bounds);
  PAGS_CHECK_MEMORY(bounds, "an order over %d ranks", ranks);
  PAGS_TRY(pags_order_find(transport, sorted, order->own, cuts + 1, ranks - 1, bounds));
  int64_t before = 0;
  for (int rank = 0; rank < ranks; rank++) {
    const int64_t end =
        rank == ranks - 1 || cuts[rank + 1] >= cuts[ranks] ? order->own : count_below(sorted, order->own, bounds[rank]);
    order->sent_items[rank] = end - before;
    before = end;
  }
  return PAGS_OK;
}

static pags_result fill(pags_transport *transport, pags_key *own, const int64_t *cuts, pags_spread_order *order) {
  PAGS_TRY(sort_keys(own, order->own, order->sent));
  PAGS_TRY(cut_keys(transport, own, cuts, order));
  PAGS_TRY(pags_share_each(transport, order->sent_items, order->arrived_items, sizeof(int64_t)));
  PAGS_TRY(pags_share_items(transport, own, order->sent_items, order->keys, order->arrived_items, sizeof *own));
  return sort_keys(order->keys, order->count, order->arrived);
}

pags_result pags_order_create(pags_transport *transport, const pags_key *keys, int64_t count, const int64_t *cuts,
                              pags_spread_order *order) {
  const int ranks = pags_transport_ranks(transport), rank = pags_transport_rank(transport);
  *order = (pags_spread_order){.first = cuts[rank], .count = cuts[rank + 1] - cuts[rank], .own = count};
  const size_t here = (size_t)order->count + 1, own = (size_t)count + 1;
  order->keys = malloc(here * sizeof *order->keys);
  order->arrived = malloc(here * sizeof *order->arrived);
  order->sent = malloc(own * sizeof *order->sent);
  order->sent_items = calloc((size_t)ranks, sizeof *order->sent_items);
  order->arrived_items = calloc((size_t)ranks, sizeof *order->arrived_items);
  PAGS_AUTOFREE pags_key *copy = malloc(own * sizeof *copy);
  const bool room = order->keys && order->arrived && order->sent && order->sent_items && order->arrived_items && copy;
  const pags_result mine = room ? PAGS_OK : pags_out_of_memory("an order of %lld items", (long long)count);
  PAGS_TRY(pags_transport_agree(transport, mine));
  memcpy(copy, keys, (size_t)count * sizeof *copy);
  return pags_transport_give_up(transport, fill(transport, copy, cuts, order));
}

pags_result pags_order_create_even(pags_transport *transport, const pags_key *keys, int64_t count,
                                   pags_spread_order *order) {
  const int ranks = pags_transport_ranks(transport);
  int64_t all = count;
  PAGS_AUTOFREE int64_t *cuts = malloc((size_t)(ranks + 1) * sizeof *cuts);
  *order = (pags_spread_order){0};
  if (!cuts)
    return pags_transport_give_up(transport, pags_out_of_memory("an order over %d ranks", ranks));
  PAGS_TRY(pags_share_sum(transport, &all, 1));
  for (int r = 0; r <= ranks; r++)
    cuts[r] = all / ranks * r + all % ranks * r / ranks;
  return pags_order_create(transport, keys, count, cuts, order);
}

void pags_order_destroy(pags_spread_order *order) {
  free(order->keys);
  free(order->arrived);
  free(order->sent);
  free(order->sent_items);
  free(order->arrived_items);
  *order = (pags_spread_order){0};
}

pags_result pags_order_move(pags_transport *transport, const pags_spread_order *order, void *own, void *placed,
                            bool back) {
  PAGS_AUTOFREE uint32_t *out = calloc((size_t)(order->own + order->count + 1), sizeof *out);
  uint32_t *const mine = own, *const here = placed;
  if (!out)
    return pags_transport_give_up(transport, pags_out_of_memory("an order of %lld items", (long long)order->count));
  uint32_t *const in = out + order->own;
  if (back) {
    for (int64_t i = 0; i < order->count; i++)
      in[order->arrived[i]] = here[i];
    PAGS_TRY(pags_share_items(transport, in, order->arrived_items, out, order->sent_items, sizeof *out));
    for (int64_t i = 0; i < order->own; i++)
      mine[order->sent[i]] = out[i];
  } else {
    for (int64_t i = 0; i < order->own; i++)
      out[i] = mine[order->sent[i]];
    PAGS_TRY(pags_share_items(transport, out, order->sent_items, in, order->arrived_items, sizeof *out));
    for (int64_t i = 0; i < order->count; i++)
      here[i] = in[order->arrived[i]];
  }
  return PAGS_OK;
}
