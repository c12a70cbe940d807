/* SPDX-License-Identifier: Apache-2.0 */
/* Parallel loops and background jobs, on a pool of threads of the library or on a host's own threads; and arenas.
 *
 * This header doesn't depend on the rest of the library. All scheduling is dynamic, so that a result must never
 * depend on which worker ran which block. To add numbers up, write one partial sum per block and add the partial
 * sums in block order: that gives the same bits for any number of threads. */
#ifndef PAGS_TASKS_H
#define PAGS_TASKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#pragma GCC visibility push(default) /* part of the public API, as PAGS_API marks it elsewhere */
#endif

typedef struct pags_tasks pags_tasks;
typedef struct pags_arena pags_arena;

/* A host's own threads. `run` must call entry(argument, w) exactly once for every w in [0, workers), concurrently
 * where it can, and return when all calls have returned. */
typedef struct pags_runner {
  void *user;  /* passed to `run` */
  int workers; /* 1..256 */
  void (*run)(void *user, void (*entry)(void *argument, int worker), void *argument);
} pags_runner;

/* Creates a pool of `threads` workers, of which worker 0 is the thread that calls pags_parallel_for. 0: as many
 * as pags_available_threads(). Returns NULL if out of memory or if threads can't be started. A process forked from this
 * one has none of the threads: there, the pool must not be used nor destroyed. */
pags_tasks *pags_tasks_create(int threads);

/* Creates the same interface over a host's threads; `runner` is copied. Returns NULL if out of memory. */
pags_tasks *pags_tasks_create_with_runner(const pags_runner *runner);

/* Runs the submitted jobs to their end, joins the threads and frees everything. NULL is allowed. */
void pags_tasks_destroy(pags_tasks *tasks);

/* Returns the number of workers, >= 1. */
int pags_tasks_workers(const pags_tasks *tasks);

/* Returns the number of processors that this process may use, >= 1: the smaller of its affinity mask and the CPU
 * quota of its cgroup (v1 or v2). */
int pags_available_threads(void);

/* Returns the bytes of memory that this process may use: the smallest of the physical memory and the limits of
 * its cgroup and that cgroup's ancestors. */
uint64_t pags_available_memory(void);

/* The body of a loop: does the items [begin, end) as worker `worker`, 0 <= worker < pags_tasks_workers. The
 * number of the worker stays the same within one call: use it to choose per-worker scratch memory, never to
 * decide a result. */
typedef void pags_block_fn(void *context, int64_t begin, int64_t end, int worker);

/* Calls fn for the items [0, count) in blocks of `grain` > 0 items. Block b is always
 *     [b*grain, min(count, (b+1)*grain))
 * and each block is claimed atomically by a worker that is free. Returns true when all blocks are done; false, with
 * unclaimed blocks left undone, if pags_tasks_cancel was called.
 *
 * A call from inside of fn is allowed: it runs its blocks on the calling worker alone, with the same worker
 * number. Otherwise only one thread at a time may call this function on the same `tasks`. */
bool pags_parallel_for(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn, void *context);

/* Makes the running loop and all later loops return false until pags_tasks_reset. May be called from any thread
 * and from a signal handler. */
void pags_tasks_cancel(pags_tasks *tasks);
/* Ends the effect of pags_tasks_cancel. */
void pags_tasks_reset(pags_tasks *tasks);
/* Returns whether loops are cancelled at present. */
bool pags_tasks_cancelled(const pags_tasks *tasks);

/* One piece of background work, e.g. decoding an image, done by a worker that has no loop to work on; loops never
 * wait for a running job. With a single worker or with a host's runner, a job runs inside of pags_job_wait. The
 * caller owns the struct, sets `run` and `context`, zeroes the rest and must keep the struct in place until
 * pags_job_wait has returned; then it may be submitted again. */
typedef struct pags_job {
  void (*run)(void *context);
  void *context;
  struct pags_job *next; /* private */
  int state;             /* private */
} pags_job;

/* Queues a job, which must not be queued or running already. May be called from any thread. */
void pags_job_submit(pags_tasks *tasks, pags_job *job);

/* Returns when the job has run; runs it on the calling thread if no worker has started it. Returns immediately for a
 * job that was never submitted. */
void pags_job_wait(pags_tasks *tasks, pags_job *job);

/* Returns the arena of a worker, for the code that this worker runs; that code also resets it. */
pags_arena *pags_tasks_arena(pags_tasks *tasks, int worker);

/* Creates an arena: a bump allocator that makes no heap calls any more once it has seen its high-water mark.
 * Blocks are aligned to 64 bytes. An arena may be used by one thread at a time. Returns NULL if out of memory. */
pags_arena *pags_arena_create(void);
/* Frees an arena with all its blocks. NULL is allowed. */
void pags_arena_destroy(pags_arena *arena);
/* Allocates count * size bytes, not cleared, valid until the next reset. Returns NULL if the product overflows or
 * if out of memory. */
void *pags_arena_alloc(pags_arena *arena, size_t count, size_t size);
/* Frees all blocks, but keeps the memory for the next round. If the last round needed more than one heap chunk,
 * the chunks are replaced by a single one here. */
void pags_arena_reset(pags_arena *arena);
/* A mark in an arena: pags_arena_release frees all blocks that were allocated since pags_arena_save returned the
 * mark. */
typedef struct pags_arena_mark {
  size_t chunk, used;
} pags_arena_mark;
pags_arena_mark pags_arena_save(const pags_arena *arena);
void pags_arena_release(pags_arena *arena, pags_arena_mark mark);
/* Return the most bytes that were ever in use at once, and the number of heap calls (for tests that
 * the steady state makes none). */
size_t pags_arena_high_water(const pags_arena *arena);
uint64_t pags_arena_heap_calls(const pags_arena *arena);

#if defined(__GNUC__)
#pragma GCC visibility pop
#endif

#ifdef __cplusplus
}
#endif
#endif
