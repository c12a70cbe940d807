/* SPDX-License-Identifier: Apache-2.0 */
/* mpi_ranks MODE: one rank of a job that test_mpi.py starts by mpirun. MODE:
 *   checks   the checks of transport_checks.c, with one part of several chunks
 *   mismatch rank 1 sends less than rank 0 expects
 *   leave    rank 1 ends while rank 0 waits for it
 *   stop     rank 1 stops its process
 *   fail     rank 1 gives up while rank 0 waits for it */
#include <pags/base.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cluster/transport_checks.h"

static int say(pags_transport *transport, bool right, const char *text) {
  if (!right && pags_transport_speaks(transport))
    fprintf(stderr, "rank %d: %s\n", pags_transport_rank(transport), text);
  pags_transport_destroy(transport, !right);
  return right ? 0 : 1;
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
  int64_t sends[2] = {rank == 1 ? 1000 : 0, 0}, receives[2] = {0, rank == 0 ? 2000 : 0};
  char data[2000] = "";
  if (rank == 1 && !strcmp(argv[1], "leave"))
    return say(transport, true, "");
  if (rank == 1 && !strcmp(argv[1], "fail")) {
    pags_transport_give_up(transport, pags_fail(PAGS_ERROR_LIMIT, "no room"));
    pags_transport_give_up(transport, pags_transport_agree(transport, PAGS_OK)); /* as callers of transports do */
    return say(transport, false, pags_error_message());
  }
  if (rank == 1 && !strcmp(argv[1], "stop"))
    raise(SIGSTOP);
  const pags_result result = pags_transport_exchange(transport, data, sends, data, receives);
  return say(transport, result == PAGS_OK, pags_error_message());
}
