/* SPDX-License-Identifier: Apache-2.0 */
/* Replays a record of one thread (threads/record.h) for other numbers of workers: a prediction, by the pool's own
 * scheduling. Workers take the blocks of a loop in order, each when it is free; a serial stretch takes as long as it
 * took. Jobs of the background are independent of each other and are replayed as one loop.
 *
 * Not modelled: that a core's clock falls while others work, but for `slow`; caches that several cores share;
 * memory that is nearer to one socket than to the other. */
#ifndef PAGS_BENCHMARKS_REPLAY_H
#define PAGS_BENCHMARKS_REPLAY_H

#include <pags/base.h>
#include "threads/record.h"

enum { PAGS_REPLAY_MOST_WORKERS = 256 };

/* What the pool and the machine cost. Times in nanoseconds. */
typedef struct pags_replay_costs {
  double fork;      /* from the call of a loop to the first block of a worker that spins */
  double claim;     /* for which a worker that takes a block keeps others from taking one */
  double join;      /* from the end of the last block to the return of the call */
  double spin;      /* a worker without work, and a caller who waits for workers, sleep after this time */
  double wake_call; /* that the caller spends for each sleeper that it wakes */
  double wake;      /* from the call to the first block of the first sleeper */
  double wake_next; /* from there to the first block of each further sleeper */
  double slow;      /* times as long as alone that a block takes while the other workers work, >= 1 */
  double bandwidth; /* bytes per nanosecond that the memory gives each worker; 0: no bound */
  double together;  /* and all of them together; 0: no bound */
} pags_replay_costs;

/* What keeps a stage from being done in its work's time divided by the number of workers. */
typedef enum pags_replay_limit {
  PAGS_REPLAY_SERIAL,  /* work outside of loops */
  PAGS_REPLAY_FEW,     /* fewer blocks than workers */
  PAGS_REPLAY_LONGEST, /* one block that takes longer than the others' share */
  PAGS_REPLAY_TAIL,    /* workers without a block at a loop's end */
  PAGS_REPLAY_FORK,    /* beginning and ending loops, taking blocks */
  PAGS_REPLAY_WAKE,    /* waking workers that sleep */
  PAGS_REPLAY_CORES,   /* cores that slow each other down */
  PAGS_REPLAY_MEMORY,  /* the memory's bandwidth */
  PAGS_REPLAY_LIMITS
} pags_replay_limit;
extern const char *const pags_replay_limit_names[PAGS_REPLAY_LIMITS];

/* A stage of a phase, over all of its events. */
typedef struct pags_replay_stage {
  const char *phase, *stage; /* never NULL; jobs have the phase "jobs" */
  int64_t loops, blocks;
  double serial, work; /* ns outside of loops; in blocks */
  double longest;      /* sum of each loop's longest block, ns */
  double bytes;        /* that its loops move, at most; set by the caller; 0: unknown */
} pags_replay_stage;

/* A stage's predicted time, ns, and what it consists of: (serial + work) / workers and what is lost to each limit. */
typedef struct pags_replay_time {
  double total, lost[PAGS_REPLAY_LIMITS];
} pags_replay_time;

/* Lists the stages of a record in the order in which they first come; the caller frees *stages. Events without a phase
 * and those of the phase "host" are left out. */
pags_result pags_replay_list(const pags_record *record, pags_replay_stage **stages, int *count);

/* Predicts the time of each stage, in the order of `stages`, for 1..PAGS_REPLAY_MOST_WORKERS workers. */
pags_result pags_replay_run(const pags_record *record, const pags_replay_stage *stages, int count, int workers,
                            const pags_replay_costs *costs, pags_replay_time *times);

#endif
