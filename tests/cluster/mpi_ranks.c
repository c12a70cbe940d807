/* SPDX-License-Identifier: Apache-2.0 */
/* mpi_ranks MODE: one rank of a job that test_mpi.py starts by mpirun. MODE:
 *   checks   the checks of every transport, with a part of several chunks
 *   mismatch rank 1 sends less than rank 0 expects
 *   leave    rank 1 ends while rank 0 waits for it
 *   stop     rank 1 stops its process
 *   fail     rank 1 fails by itself while rank 0 waits for it
 *   overlap  a part arrives before it is waited for */
#include <pags/base.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "cluster/transport_checks.h"

static int say(pags_transport *transport, bool right, const char *text) {
  if (!right && pags_transport_speaks(transport))
    fprintf(stderr, "rank %d: %s\n", pags_transport_rank(transport), text);
  pags_transport_destroy(transport, !right);
  return right ? 0 : 1;
}

/* Rank 1 sends 64 MB. Rank 0 looks at nothing but its buffer until the last byte is there, or for 20 seconds. */
static int overlap(pags_transport *transport) {
  enum { BYTES = 64000000 };
  const int rank = pags_transport_rank(transport);
  volatile char *data = calloc(BYTES, 1);
  int64_t nothing[2] = {0, 0}, sends[2] = {BYTES, 0}, receives[2] = {0, BYTES};
  if (!data)
    return say(transport, false, "out of memory");
  data[BYTES - 1] = (char)rank;
  pags_transfer *transfer;
  if (pags_transport_exchange_begin(transport, (char *)data, rank == 1 ? sends : nothing, (char *)data,
                                    rank == 0 ? receives : nothing, &transfer) != PAGS_OK)
    return say(transport, false, pags_error_message());
  for (const double until = pags_clock_ms() + 20000; data[BYTES - 1] == 0 && pags_clock_ms() < until;)
    ;
  const bool came = data[BYTES - 1] == 1;
  const pags_result result = pags_transport_exchange_finish(transport, transfer);
  free((char *)data);
  return say(transport, came && result == PAGS_OK, came ? pags_error_message() : "it comes when it is waited for");
}

int main(int argc, char **argv) {
  pags_transport *transport;
  if (argc != 2 || pags_transport_create_mpi(&transport) != PAGS_OK) {
    fprintf(stderr, "%s\n", pags_error_message());
    return 1;
  }
  const int rank = pags_transport_rank(transport);
  if (!strcmp(argv[1], "checks")) {
    const char *wrong = transport_checks(transport, 150000003);
    return say(transport, !*wrong, wrong);
  }
  if (!strcmp(argv[1], "overlap"))
    return overlap(transport);
  int64_t sends[2] = {rank == 1 ? 1000 : 0, 0}, receives[2] = {0, rank == 0 ? 2000 : 0};
  char data[2000] = "";
  if (rank == 1 && !strcmp(argv[1], "leave"))
    return say(transport, true, "");
  if (rank == 1 && !strcmp(argv[1], "fail")) {
    pags_transport_give_up(transport, pags_fail(PAGS_ERROR_LIMIT, "no room"));
    pags_transport_give_up(transport, pags_transport_agree(transport, PAGS_OK)); /* as what is around it does, too */
    return say(transport, false, pags_error_message());
  }
  if (rank == 1 && !strcmp(argv[1], "stop"))
    raise(SIGSTOP);
  const pags_result result = pags_transport_exchange(transport, data, sends, data, receives);
  return say(transport, result == PAGS_OK, pags_error_message());
}
