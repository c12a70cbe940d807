/* SPDX-License-Identifier: Apache-2.0 */
/* Runs a function on several ranks, which are threads of the test. */
#ifndef PAGS_TESTS_THREAD_RANKS_H
#define PAGS_TESTS_THREAD_RANKS_H

#include "cluster/transport.h"
#include "port/port.h"

#include <stdio.h>

enum { THREAD_RANKS_MOST = 64 };

/* Creates the transports of `ranks` threads of this process. bytes_a_second > 0 limits the rate at which each rank
 * sends and the rate at which it receives. `watchdog` is in seconds. Each rank destroys its transport. */
pags_result pags_transport_create_threads(int ranks, double bytes_a_second, double watchdog,
                                          pags_transport **transports);

/* The work of one rank. Returns "" or a message about a fault. It may not use cmocka's asserts, which belong to the
 * main thread. */
typedef const char *rank_fn(pags_transport *transport, void *user);

typedef struct rank_thread {
  pags_transport *transport;
  rank_fn *run;
  void *user;
  char wrong[2048];
} rank_thread;

static inline void *run_rank(void *argument) {
  rank_thread *self = argument;
  snprintf(self->wrong, sizeof self->wrong, "%s", self->run(self->transport, self->user));
  pags_transport_destroy(self->transport, self->wrong[0] != '\0');
  return NULL;
}

/* Runs `run` on every rank and prints the faults. Returns whether there was none. */
static inline bool run_ranks(int ranks, double bytes_a_second, double watchdog, rank_fn *run, void *user) {
  pags_transport *transports[THREAD_RANKS_MOST];
  static rank_thread threads[THREAD_RANKS_MOST];
  pthread_t handles[THREAD_RANKS_MOST];
  if (pags_transport_create_threads(ranks, bytes_a_second, watchdog, transports) != PAGS_OK)
    return false;
  bool right = true;
  for (int rank = 0; rank < ranks; rank++) {
    threads[rank] = (rank_thread){transports[rank], run, user, ""};
    right &= pthread_create(&handles[rank], NULL, run_rank, &threads[rank]) == 0;
  }
  for (int rank = 0; rank < ranks; rank++) {
    pthread_join(handles[rank], NULL);
    if (threads[rank].wrong[0])
      printf("rank %d of %d: %s\n", rank, ranks, threads[rank].wrong);
    right &= threads[rank].wrong[0] == '\0';
  }
  return right;
}

#endif
