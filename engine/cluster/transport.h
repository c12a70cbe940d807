/* SPDX-License-Identifier: Apache-2.0 */
/* Messages between the ranks of one job: processes on one or more machines (MPI), or one process alone, whose transport
 * is NULL. Tests have ranks that are threads of one process (tests/cluster/thread_transport.c).
 *
 * All ranks call the collective functions in the same order, with sizes that agree: what rank a sends to rank b is as
 * large as what b receives from a. Sizes are bytes in 64 bits. A function must be called by one thread of a rank at a
 * time.
 *
 * No call waits for ever. A rank that dies, leaves or is silent for longer than the watchdog's time makes the calls of
 * all others fail with PAGS_ERROR_IO and a message that names it; from then on every call fails. A rank is silent when
 * its process doesn't run or can't be reached; one that computes for long isn't. */
#ifndef PAGS_CLUSTER_TRANSPORT_H
#define PAGS_CLUSTER_TRANSPORT_H

#include <pags/base.h>
#include <stdbool.h>

typedef struct pags_transport pags_transport;
enum { PAGS_RANKS_MOST = 4096 };

int pags_transport_rank(const pags_transport *transport);  /* 0 .. ranks - 1 */
int pags_transport_ranks(const pags_transport *transport); /* >= 1 */

/* ---- Collective: every rank calls them ---- */

/* All to all. `send` holds the part for rank 0, then that for rank 1, and so on, of send_bytes[rank] each; `receive`
 * gets the parts in the order of the ranks that sent them. The rank's own part is copied. A buffer whose parts are all
 * empty may be NULL. */
pags_result pags_transport_exchange(pags_transport *transport, const void *send, const int64_t *send_bytes,
                                    void *receive, const int64_t *receive_bytes);

/* Copies `bytes` of root's data to every rank. */
pags_result pags_transport_broadcast(pags_transport *transport, int root, void *data, int64_t bytes);

/* Brings every rank's bytes to `root`, where `receive` gets them in the order of the ranks; receive_bytes[rank] each.
 * Elsewhere `receive` and `receive_bytes` are ignored. */
pags_result pags_transport_gather(pags_transport *transport, int root, const void *send, int64_t bytes, void *receive,
                                  const int64_t *receive_bytes);

/* Agrees on how a piece of work ended on all ranks: PAGS_OK if it did everywhere; else the failure of the lowest rank
 * that failed, its message beginning with "rank R: " unless all say the same or it is a cancellation (which counts only
 * if nothing worse happened). Every rank then has the same result and message. `mine` comes with this thread's error
 * message. */
pags_result pags_transport_agree(pags_transport *transport, pags_result mine);

/* ---- A failure of one rank alone ---- */

/* For a rank that can't go on while the others don't know: every call fails from now on, on all ranks, with this
 * failure and "rank R: " before its message. With MPI the others don't hear of it: this rank speaks, and its
 * pags_transport_destroy, which must follow soon, ends them. Nothing happens if `mine` is PAGS_OK, if the ranks have
 * agreed on it or if calls fail already. `mine` comes with this thread's error message. Returns `mine`. A collective
 * function ends with it where it may fail at one rank alone. */
pags_result pags_transport_give_up(pags_transport *transport, pags_result mine);

/* ---- Progress of ranks: no waiting, no order ---- */

/* Reports the progress of this rank to the others, in the caller's unit, and whether it ends early. They receive it
 * within half a second. */
void pags_transport_tell(pags_transport *transport, int64_t done, bool ends_early);
/* Returns the sum of the progress of all ranks, and whether one of them ends early or can't be reached. */
void pags_transport_hear(const pags_transport *transport, int64_t *done, bool *ends_early);

/* Whether this rank is the one that prints for all: rank 0, or the lowest that is left; and one that gave up. */
bool pags_transport_speaks(const pags_transport *transport);

/* ---- Counters ---- */

typedef struct pags_transport_counters {
  int64_t bytes_sent, bytes_received; /* to and from other ranks */
} pags_transport_counters;

pags_transport_counters pags_transport_counted(const pags_transport *transport);

/* ---- Beginning and end ---- */

/* Seconds of silence after which a rank is given up: the environment variable PAGS_WATCHDOG, by default 60. */
double pags_transport_watchdog(void);

/* Ends this rank's part. `failed`: without waiting for the others. NULL is allowed. With MPI, a failure ends the
 * process with code 1, and mpirun ends the rest. */
void pags_transport_destroy(pags_transport *transport, bool failed);

/* Whether this process was started by mpirun or srun as one of several or as a single rank of MPI. */
bool pags_transport_started_by_mpi(void);
/* Joins the job of MPI; *transport stays NULL for a job of one rank. Errors: PAGS_ERROR_UNSUPPORTED if this build has
 * no MPI. At most once a process. */
pags_result pags_transport_create_mpi(pags_transport **transport);

#endif
