/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the transport of one process and the transport of threads: delivery, failures, and the time that a limited rate
 * takes. mpi_ranks.c runs the same checks under mpirun. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "base/clock.h"
#include "cluster/thread_ranks.h"
#include "cluster/transport_checks.h"

static const char *all_checks(pags_transport *transport, void *user) {
  (void)user;
  return transport_checks(transport, 100000);
}

static void test_one_process(void **state) {
  (void)state;
  assert_int_equal(pags_transport_ranks(NULL), 1);
  assert_int_equal(pags_transport_rank(NULL), 0);
  assert_string_equal(transport_checks(NULL, 0), "");
  assert_int_equal(pags_transport_counted(NULL).bytes_sent, 0);
}

static void test_ranks(void **state) {
  (void)state;
  for (int ranks = 1; ranks <= 5; ranks++)
    assert_true(run_ranks(ranks, 0, 60, all_checks, NULL));
  assert_true(run_ranks(4, 1e9, 60, all_checks, NULL));
}

/* ---- Failures: rank 1 never sends the data that the others wait for ---- */

static const char *leave(pags_transport *transport, void *user) {
  const bool *returns = user; /* false: rank 1 is silent until the others have gone */
  if (pags_transport_rank(transport) == 1) {
    bool gone;
    for (int64_t given_up = *returns ? 2 : 0; given_up < 2;)
      pags_transport_hear(transport, &given_up, &gone);
    return "";
  }
  int value = 0;
  if (pags_transport_broadcast(transport, 1, &value, sizeof value) != PAGS_ERROR_IO)
    return "a rank that never sends must be an error";
  pags_transport_tell(transport, 1, true);
  if (!strstr(pags_error_message(), *returns ? "rank 1 of 3 has ended" : "rank 1 of 3 has been silent for 0.2 s"))
    return pags_error_message();
  /* all later calls fail */
  return pags_transport_broadcast(transport, 0, &value, sizeof value) == PAGS_ERROR_IO ? "" : "it must stay broken";
}

static void test_lost_rank(void **state) {
  (void)state;
  for (int i = 0; i < 2; i++) {
    bool returns = i == 0;
    assert_true(run_ranks(3, 0, returns ? 60 : 0.2, leave, &returns));
  }
}

/* Rank 2 gives up. Ranks 0 and 1 learn of this while they wait, each in another call. */
static const char *give_up(pags_transport *transport, void *unused) {
  (void)unused;
  static const char *const expected = "rank 2: no room";
  const int rank = pags_transport_rank(transport);
  int64_t number = rank;
  if (rank == 2 && pags_transport_give_up(transport, pags_fail(PAGS_ERROR_LIMIT, "no room")) != PAGS_ERROR_LIMIT)
    return "give_up must return what it gets";
  const pags_result result = rank == 1 ? pags_transport_agree(transport, PAGS_OK)
                                       : pags_transport_broadcast(transport, 2, &number, sizeof number);
  if (result != PAGS_ERROR_LIMIT || strcmp(pags_error_message(), expected) != 0)
    return pags_error_message();
  /* giving up with this failure changes nothing, and all later calls fail */
  pags_transport_give_up(transport, result);
  if (pags_transport_agree(transport, PAGS_OK) != PAGS_ERROR_LIMIT || strcmp(pags_error_message(), expected) != 0)
    return pags_error_message();
  return "";
}

/* Giving up with a result that all ranks agreed on has no effect. */
static const char *agree_first(pags_transport *transport, void *unused) {
  (void)unused;
  const pags_result mine = pags_transport_rank(transport) == 1 ? pags_fail(PAGS_ERROR_LIMIT, "no room") : PAGS_OK;
  const pags_result agreed = pags_transport_agree(transport, mine);
  pags_transport_give_up(transport, agreed);
  return agreed == PAGS_ERROR_LIMIT && pags_transport_agree(transport, PAGS_OK) == PAGS_OK ? "" : pags_error_message();
}

static void test_one_gives_up(void **state) {
  (void)state;
  assert_true(run_ranks(3, 0, 60, give_up, NULL));
  assert_true(run_ranks(3, 0, 60, agree_first, NULL));
  assert_int_equal(pags_transport_give_up(NULL, PAGS_ERROR_IO), PAGS_ERROR_IO);
}

/* ---- Rate ---- */

/* Every rank sends `bytes` bytes to every other rank. */
typedef struct load {
  int64_t bytes;
  double took_ms[THREAD_RANKS_MOST];
} load;

static char sent[3000000], received[3][3000000];

static const char *exchange_load(pags_transport *transport, void *user) {
  load *l = user;
  int64_t bytes[3];
  const int rank = pags_transport_rank(transport);
  for (int other = 0; other < 3; other++)
    bytes[other] = other == rank ? 0 : l->bytes;
  double since = pags_clock_ms();
  if (pags_transport_exchange(transport, sent, bytes, received[rank], bytes) != PAGS_OK)
    return pags_error_message();
  l->took_ms[rank] = pags_clock_lap_ms(&since);
  return "";
}

/* Each of three ranks sends and receives 2 x 1,000,000 bytes. At 20 MB/s, each end is busy for at least 100 ms. */
static void test_rate(void **state) {
  (void)state;
  load l = {.bytes = 1000000};
  assert_true(run_ranks(3, 20e6, 60, exchange_load, &l));
  for (int rank = 0; rank < 3; rank++)
    assert_true(l.took_ms[rank] >= 100);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_one_process),  cmocka_unit_test(test_ranks), cmocka_unit_test(test_lost_rank),
      cmocka_unit_test(test_one_gives_up), cmocka_unit_test(test_rate),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
