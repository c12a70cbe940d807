/* SPDX-License-Identifier: Apache-2.0 */
/* The ranks of a job that mpirun started, of which this process is one: verbs share numbered work out among them, and
 * rank 0 prints and writes the report. Without mpirun there is one rank, and all of this does nothing. */
#ifndef PAGS_CLI_RANKS_H
#define PAGS_CLI_RANKS_H

#include "cluster/transport.h"

/* Joins the job, for a verb that shares its work out. Others must not be started several times. */
pags_result pags_ranks_join(void);
/* Leaves it. After a failure of the job itself this ends the program, and all of the job's. */
void pags_ranks_leave(void);

pags_transport *pags_ranks(void); /* NULL: one process */
bool pags_ranks_lead(void);       /* rank 0 */

/* Work is dealt out like cards: of items 0, 1, 2, ... this rank's are rank, rank + ranks, ... */
bool pags_ranks_mine(int64_t item);

/* Tells the others that `done` of this rank's items are done, and whether it ends before all are; returns the sum of
 * all ranks' (as far as heard, no less than `done`). */
int64_t pags_ranks_tell(int64_t done, bool ends_early);
/* Whether another rank has said that it ends early, so that this one should, too. */
bool pags_ranks_stopping(void);

/* ---- Collective ---- */

/* Makes *value the sum over all ranks. */
pags_result pags_ranks_sum(int64_t *value);
/* Brings the bytes of all ranks to rank 0, in the order of ranks: *all is freed by the caller; NULL elsewhere. */
pags_result pags_ranks_gather(const void *own, int64_t bytes, void **all, int64_t *all_bytes);

#endif
