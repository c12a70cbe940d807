/* SPDX-License-Identifier: Apache-2.0 */
/* A runner for parallel loops: our own pool of threads, or the host's.
 *
 * Knows nothing of scenes. All scheduling is dynamic, so nothing may depend on which worker ran which block; work that
 * sums must write one partial per block and add the partials in block order (the same bits for any number of threads).
 */
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

/* A host's own threads. `run` calls entry(argument, w) once for every w in [0, workers), at the same time where it
 * can, and returns when all have returned. */
typedef struct pags_runner {
  void *user;
  int workers; /* 1..256 */
  void (*run)(void *user, void (*entry)(void *argument, int worker), void *argument);
} pags_runner;

/* A pool of `threads` workers, the calling thread being worker 0. threads = 0: as many as pags_available_threads().
 * NULL when memory or threads can't be had. */
pags_tasks *pags_tasks_create(int threads);

/* The same interface over a host's threads; `runner` is copied. */
pags_tasks *pags_tasks_create_with_runner(const pags_runner *runner);

/* Waits for submitted jobs, joins the threads, frees everything. NULL is allowed. */
void pags_tasks_destroy(pags_tasks *tasks);

/* Number of workers, >= 1. */
int pags_tasks_workers(const pags_tasks *tasks);

/* Processors this process may use: the smaller of its affinity mask and its cgroup's (v1 or v2) CPU quota, >= 1. */
int pags_available_threads(void);

/* Bytes of memory this process may use: the smaller of physical memory and the limits of its cgroup and ancestors. */
uint64_t pags_available_memory(void);

/* Does [begin, end) of a loop as worker `worker` (0 <= worker < pags_tasks_workers, stable within one call: use it to
 * choose per-worker scratch, never to decide a result). */
typedef void pags_block_fn(void *context, int64_t begin, int64_t end, int worker);

/* Calls fn over [0, count) in blocks of `grain` items (the last may be shorter), each claimed atomically by whichever
 * worker is free. Block b is always [b*grain, min(count, (b+1)*grain)). Returns when all blocks are done.
 * A call from inside of fn is allowed and runs its blocks on the calling worker alone, with the same worker index.
 * Only one thread at a time may call it on the same `tasks` from outside.
 * Returns false, leaving unclaimed blocks undone, when pags_tasks_cancel was called. */
bool pags_parallel_for(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn, void *context);

/* Makes the running and all later loops return false until pags_tasks_reset. Safe from any thread and from a signal
 * handler. */
void pags_tasks_cancel(pags_tasks *tasks);
void pags_tasks_reset(pags_tasks *tasks);
bool pags_tasks_cancelled(const pags_tasks *tasks);

/* One piece of background work (decoding an image, say), done by a worker that has no loop to help with; loops never
 * wait for a running job. With a single worker, or a host's runner, jobs run inside pags_job_wait. The struct is
 * the caller's, must stay in place until waited for and may then be submitted again. */
typedef struct pags_job {
  void (*run)(void *context);
  void *context;
  struct pags_job *next; /* ours */
  int state;             /* ours */
} pags_job;

void pags_job_submit(pags_tasks *tasks, pags_job *job);
/* Returns when `job` has run; runs it on this thread if nobody has begun it. A job never submitted returns at once. */
void pags_job_wait(pags_tasks *tasks, pags_job *job);

/* Worker `worker`'s own arena, reset by its user. */
pags_arena *pags_tasks_arena(pags_tasks *tasks, int worker);

/* A bump allocator that stops calling the heap once it has seen its high-water mark. Blocks are aligned to 64 bytes.
 * Not for several threads at once. */
pags_arena *pags_arena_create(void);
void pags_arena_destroy(pags_arena *arena);
/* count * size bytes, not cleared; NULL when the product overflows or memory is out. Valid until the next reset. */
void *pags_arena_alloc(pags_arena *arena, size_t count, size_t size);
/* Forgets all blocks. If the last round needed more than one heap chunk, they become a single one here. */
void pags_arena_reset(pags_arena *arena);
/* A place to come back to: release frees everything allocated since the mark. */
typedef struct pags_arena_mark {
  size_t chunk, used;
} pags_arena_mark;
pags_arena_mark pags_arena_save(const pags_arena *arena);
void pags_arena_release(pags_arena *arena, pags_arena_mark mark);
/* Most bytes that were ever in use at once, and heap calls made so far (for the test that steady state makes none). */
size_t pags_arena_high_water(const pags_arena *arena);
uint64_t pags_arena_heap_calls(const pags_arena *arena);

#if defined(__GNUC__)
#pragma GCC visibility pop
#endif

#ifdef __cplusplus
}
#endif
#endif
