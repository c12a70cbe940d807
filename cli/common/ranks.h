/* SPDX-License-Identifier: Apache-2.0 */
/* The ranks of a job started by mpirun, one of which is this process. Verbs distribute numbered work items over them;
 * rank 0 prints and writes the report. Without mpirun there is one rank, and these functions do nothing. */
#ifndef PAGS_CLI_RANKS_H
#define PAGS_CLI_RANKS_H

#include "cluster/transport.h"

/* Joins the job. */
pags_result pags_ranks_join(void);
/* Leaves the job. After a failure of the job itself, ends this program and all others of the job. */
void pags_ranks_leave(void);

pags_transport *pags_ranks(void); /* NULL: one process */
bool pags_ranks_lead(void);       /* rank 0 */

/* Round-robin distribution: of items 0, 1, 2, ... this rank has rank, rank + ranks, ... */
bool pags_ranks_mine(int64_t item);

/* Reports that `done` items of this rank are finished, and whether it ends early; returns the sum over all ranks as far
 * as known, at least `done`. */
int64_t pags_ranks_tell(int64_t done, bool ends_early);
/* Whether another rank ends early, so that this one should, too. */
bool pags_ranks_stopping(void);

/* ---- Collective ---- */

/* Makes *value the sum over all ranks. */
pags_result pags_ranks_sum(int64_t *value);
/* Gathers the items of all ranks, of `size` bytes each, on rank 0 in the order of ranks: into the array at `all`, the
 * address of a pointer, which becomes NULL on other ranks. The caller frees it. */
pags_result pags_ranks_gather(const void *own, int64_t count, size_t size, void *all, int64_t *all_count);

#endif
