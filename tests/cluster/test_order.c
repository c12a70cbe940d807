/* SPDX-License-Identifier: Apache-2.0 */
/* Compares orders, order statistics, sums and shares of rows over one to five ranks with serial code. The rows are
 * split at random. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "base/sort.h"
#include "cluster/order.h"
#include "cluster/shares.h"
#include "cluster/thread_ranks.h"

enum { MOST_RANKS = 5, MOST_ITEMS = 3000 };

/* Items of all ranks; rank r has items [own[r], own[r + 1]) and receives positions [cuts[r], cuts[r + 1]). */
typedef struct job {
  int64_t count;
  pags_key keys[MOST_ITEMS];
  uint32_t values[MOST_ITEMS];
  int64_t own[MOST_RANKS + 1], cuts[MOST_RANKS + 1];
  int64_t expected[MOST_ITEMS]; /* the items after sorting */
} job;

static uint32_t dice(uint64_t seed, uint64_t at, uint32_t sides) {
  uint32_t bits[4];
  pags_rng_u32x4(seed, 1, at, bits);
  return bits[0] % sides;
}

static const job *sorted_job;
static int by_key(const void *a, const void *b) {
  const pags_key x = sorted_job->keys[*(const int64_t *)a], y = sorted_job->keys[*(const int64_t *)b];
  if (x.high != y.high)
    return x.high < y.high ? -1 : 1;
  return x.low < y.low ? -1 : x.low > y.low;
}

static void split(int64_t count, int ranks, uint64_t seed, int64_t *begin) {
  double at[MOST_RANKS + 1];
  for (int r = 0; r <= ranks; r++)
    at[r] = r == 0 ? 0 : r == ranks ? (double)count : (double)dice(seed, (uint64_t)r, (uint32_t)count + 1);
  pags_sort_doubles(at, ranks + 1);
  for (int r = 0; r <= ranks; r++)
    begin[r] = (int64_t)at[r];
}

/* Fills in random items. If `few` > 0, the keys have only `few` different high halves, so that the low halves decide.
 */
static void fill(job *j, int ranks, int64_t count, uint32_t few, uint64_t seed) {
  j->count = count;
  for (int64_t i = 0; i < count; i++) {
    uint32_t bits[4];
    pags_rng_u32x4(seed, 2, (uint64_t)i, bits);
    j->keys[i].high = few ? bits[0] % few : (uint64_t)bits[0] << 32 | bits[1];
    j->keys[i].low = (uint64_t)(bits[2] % 3) << 40 | (uint64_t)i;
    j->values[i] = bits[3];
    j->expected[i] = i;
  }
  sorted_job = j;
  pags_sort(j->expected, count, sizeof *j->expected, by_key);
  split(count, ranks, seed + 1, j->own);
  split(count, ranks, seed + 2, j->cuts);
}

static bool same(pags_key a, pags_key b) {
  return a.high == b.high && a.low == b.low;
}

static const char *check_find(pags_transport *t, const job *j) {
  const int64_t first = j->own[pags_transport_rank(t)], own = j->own[pags_transport_rank(t) + 1] - first;
  int64_t positions[4] = {0, j->count / 3, j->count - 1, j->count};
  pags_key keys[MOST_ITEMS], found[4];
  memcpy(keys, j->keys + first, (size_t)own * sizeof *keys);
  if (pags_keys_sort(keys, own) != PAGS_OK || pags_order_find(t, keys, own, positions, 4, found) != PAGS_OK)
    return pags_error_message();
  for (int k = 0; k < 4; k++) {
    const pags_key end = {UINT64_MAX, UINT64_MAX};
    const bool behind = positions[k] >= j->count || positions[k] < 0;
    if (positions[k] >= 0 && !same(found[k], behind ? end : j->keys[j->expected[positions[k]]]))
      return "the item at a position is another one";
  }
  return "";
}

static const char *check_moves(pags_transport *t, const job *j, const pags_spread_order *order) {
  uint32_t placed[MOST_ITEMS], back[MOST_ITEMS], own[MOST_ITEMS];
  const int64_t first = j->own[pags_transport_rank(t)];
  memcpy(own, j->values + first, (size_t)order->own * sizeof *own);
  if (pags_order_move(t, order, own, placed, false) != PAGS_OK)
    return pags_error_message();
  for (int64_t i = 0; i < order->count; i++) {
    if (placed[i] != j->values[j->expected[order->first + i]])
      return "a value went to another place";
    placed[i] += (uint32_t)(order->first + i);
  }
  if (pags_order_move(t, order, back, placed, true) != PAGS_OK)
    return pags_error_message();
  for (int64_t position = 0; position < j->count; position++) {
    const int64_t item = j->expected[position];
    if (item >= first && item < first + order->own && back[item - first] != j->values[item] + (uint32_t)position)
      return "a value came back to another item";
  }
  return "";
}

static const char *check_order(pags_transport *t, void *user) {
  const job *const j = user;
  const int rank = pags_transport_rank(t);
  const int64_t own = j->own[rank + 1] - j->own[rank];
  pags_spread_order order;
  if (pags_order_create(t, j->keys + j->own[rank], own, j->cuts, &order) != PAGS_OK)
    return pags_error_message();
  const char *fault =
      order.first == j->cuts[rank] && order.count == j->cuts[rank + 1] - j->cuts[rank] && order.own == own
          ? ""
          : "another number of items";
  for (int64_t i = 0; !*fault && i < order.count; i++)
    if (!same(order.keys[i], j->keys[j->expected[order.first + i]]))
      fault = "another key at a position";
  if (!*fault)
    fault = check_moves(t, j, &order);
  pags_order_destroy(&order);
  return *fault ? fault : check_find(t, j);
}

static void test_order(void **state) {
  (void)state;
  job *const j = calloc(1, sizeof *j);
  assert_non_null(j);
  const int64_t counts[] = {0, 1, 17, MOST_ITEMS};
  for (int ranks = 1; ranks <= MOST_RANKS; ranks++)
    for (int c = 0; c < 4; c++)
      for (uint64_t seed = 0; seed < 4; seed++) {
        fill(j, ranks, counts[c], seed % 2 ? 3 : 0, 100 * seed + (uint64_t)ranks);
        assert_true(run_ranks(ranks, 0, 60, check_order, j));
      }
  fill(j, 1, MOST_ITEMS, 0, 9);
  assert_string_equal(check_order(NULL, j), "");
  free(j);
}

static void test_keys_of_numbers(void **state) {
  (void)state;
  const double ascending[] = {-1e300, -2.5, -1e-310, 0, 1e-310, 1, 1.0000000001, 1e300};
  for (int i = 0; i < 8; i++) {
    assert_true(pags_double_of_key(pags_key_of_double(ascending[i])) == ascending[i]);
    assert_true(i == 0 || pags_key_of_double(ascending[i - 1]) < pags_key_of_double(ascending[i]));
  }
  assert_true(pags_key_of_double(-0.0) == pags_key_of_double(0.0));
  assert_true(pags_key_of_float(-1.5f) == pags_key_of_double(-1.5));
}

/* ---- Sums and parts ---- */

static const char *check_sums(pags_transport *t, void *user) {
  const int rank = pags_transport_rank(t), ranks = pags_transport_ranks(t);
  int64_t numbers[3] = {rank, 10, -rank}, before, all, bytes_of[MOST_RANKS];
  char text[MOST_RANKS + 1] = "abcde", *parts;
  (void)user;
  if (pags_share_sum(t, numbers, 3) != PAGS_OK || pags_share_before(t, rank + 1, &before, &all) != PAGS_OK)
    return pags_error_message();
  if (numbers[0] != ranks * (ranks - 1) / 2 || numbers[1] != 10 * ranks || numbers[2] != -numbers[0])
    return "another sum";
  if (before != rank * (rank + 1) / 2 || all != ranks * (ranks + 1) / 2)
    return "another sum before this rank";
  if (pags_share_parts(t, text, rank, (void **)&parts, bytes_of) != PAGS_OK)
    return pags_error_message();
  const char *const expected = "aababcabcd";
  const bool right =
      memcmp(parts, expected, (size_t)(ranks * (ranks - 1) / 2)) == 0 && bytes_of[ranks - 1] == ranks - 1;
  free(parts);
  return right ? "" : "other parts";
}

static void test_sums(void **state) {
  (void)state;
  for (int ranks = 1; ranks <= MOST_RANKS; ranks++)
    assert_true(run_ranks(ranks, 0, 60, check_sums, NULL));
}

/* ---- Shares of rows ---- */

static void test_shares(void **state) {
  (void)state;
  for (int ranks = 1; ranks <= MOST_RANKS; ranks++)
    for (uint64_t seed = 0; seed < 50; seed++) {
      int64_t rows[4], begin[4 * (MOST_RANKS + 1)], all = 0, largest = 0;
      for (int m = 0; m < 4; m++) {
        rows[m] = dice(seed, (uint64_t)m, m == 0 ? 20000 : 900);
        all += rows[m];
        largest = m > 0 && rows[m] > largest ? rows[m] : largest;
      }
      pags_shares_cut(rows, 4, 64, ranks, begin);
      for (int m = 0; m < 4; m++) {
        const int64_t *const cuts = begin + m * (ranks + 1);
        assert_int_equal(cuts[0], 0);
        assert_int_equal(cuts[ranks], rows[m]);
        for (int r = 0; r < ranks; r++) {
          assert_true(cuts[r] <= cuts[r + 1]);
          assert_true(cuts[r] == rows[m] || (m == 0 ? cuts[r] % 64 == 0 : cuts[r] == 0));
        }
      }
      for (int r = 0; r < ranks; r++) {
        int64_t own = 0;
        for (int m = 0; m < 4; m++)
          own += begin[m * (ranks + 1) + r + 1] - begin[m * (ranks + 1) + r];
        assert_true(llabs(own - all / ranks) <= 64 + largest + 1); /* each end moves by less than a cluster or half an
                                                                      object */
      }
    }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_order), cmocka_unit_test(test_keys_of_numbers),
                                     cmocka_unit_test(test_sums), cmocka_unit_test(test_shares)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
