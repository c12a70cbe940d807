/* SPDX-License-Identifier: Apache-2.0 */
/* A record of what a pool's calling thread did: loops with the time of each block, the serial stretches between them,
 * and jobs that it waited for, each under the names of the phase and the stage that were set last. pags-bench replays
 * it for other numbers of workers.
 *
 * Only the thread that calls the loops writes to a record. With one worker every block is timed; with more, only the
 * calls are. */
#ifndef PAGS_THREADS_RECORD_H
#define PAGS_THREADS_RECORD_H

#include <pags/tasks.h>

typedef enum pags_event_kind {
  PAGS_EVENT_SERIAL, /* work outside of loops */
  PAGS_EVENT_LOOP,
  PAGS_EVENT_JOB /* a job that ran on the calling thread, or that it waited for */
} pags_event_kind;

typedef struct pags_event {
  pags_event_kind kind;
  const char *phase, *stage; /* NULL: none was set */
  bool begins;               /* the first event since the phase was set */
  int64_t ns;                /* the whole event */
  int64_t first, count; /* LOOP: its blocks' times are `block_ns` from `first` on; with more workers than one none */
} pags_event;

/* Zeroed at first but for `workers`. `lost`: memory ran out, and the record ends there. */
typedef struct pags_record {
  int workers; /* > 0: pags_tasks_workers returns this while it is recorded, so that loops are cut for that number */
  pags_event *events;
  int64_t count, capacity;
  int64_t *block_ns;
  int64_t blocks, block_capacity;
  const char *phase, *stage;
  bool begins;  /* of the next event */
  int64_t last; /* clock, ns: until then everything is recorded */
  bool lost;
} pags_record;

/* Frees what a record holds. */
void pags_record_destroy(pags_record *record);

/* ---- Used by the pool ---- */

/* Ends the current activity as an event of this kind, which began where the last event ended; drops it if it took no
 * time. */
void pags_record_end(pags_record *record, pags_event_kind kind);
/* Ends a block of the current loop. */
void pags_record_block(pags_record *record);
/* Ends the loop whose last `blocks` blocks were recorded and which began at `begin`. */
void pags_record_loop(pags_record *record, int64_t begin, int64_t blocks);

/* ---- Of the pool (pool.c) ---- */

/* Starts recording the calling thread; NULL: stops. The record belongs to the caller and must exist until then. Nothing
 * else may use the pool during the call. */
void pags_tasks_record(pags_tasks *tasks, pags_record *record);

/* Names the next activity of the calling thread: `phase` (NULL: the same as before) and the stage of it. The texts
 * must stay. Without a record, and inside of a loop's block, it does nothing. */
void pags_tasks_mark(pags_tasks *tasks, const char *phase, const char *stage);

#endif
