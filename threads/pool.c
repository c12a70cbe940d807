/* SPDX-License-Identifier: Apache-2.0 */
/* The thread pool (pags/tasks.h): parallel loops, background jobs, and the same interface over a host's threads.
 *
 * Workers join a loop by themselves; nothing is assigned to them. The caller writes the description of the loop, sets
 * the "open" bit of the atomic `gate`, and works on the loop like every worker. A worker that sees the bit set adds
 * itself to the count in `gate`, takes blocks until none is left, clears the bit and subtracts itself. The loop is
 * over when the bit is clear and the count is zero. So nobody waits for a worker that is busy with a job or asleep,
 * and the description may be overwritten as soon as the loop is over, since nobody can join a loop that is closed.
 *
 * A training step runs dozens of loops in short succession, hence idle workers spin on the gate for a moment before
 * they sleep. The count of sleepers and the gate are sequentially consistent atomics: either the worker that is about
 * to sleep sees the open gate, or the caller sees the sleeper, so that no wake-up is lost.
 *
 * A pool may have more workers than the process has processors. Then only as many are awake as there are processors:
 * one more would take the processor of a worker that has a block, and end the loop later. */
#include <pags/tasks.h>

#include <assert.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "port/port.h"
#include "threads/record.h"

/* How long a thread spins before it sleeps: a few times the cost of a wake-up through the kernel (5 to 10 us). */
enum { SPIN_NANOSECONDS = 40000 };

/* Bits of the gate; the lower 30 bits count the workers that have joined the loop. */
#define GATE_OPEN 0x80000000u
#define GATE_AWAITED 0x40000000u /* the caller sleeps until the count is zero */
#define GATE_COUNT 0x3fffffffu

enum { JOB_IDLE, JOB_QUEUED, JOB_RUNNING, JOB_DONE };

typedef struct loop {
  int64_t count, grain;
  uint64_t blocks;
  pags_block_fn *fn;
  void *context;
} loop;

typedef struct hand {
  pags_tasks *tasks;
  int worker;
  pthread_t thread;
} hand;

struct pags_tasks {
  int workers;
  int started; /* threads of the pool that run */
  int useful;  /* of them, that may be awake at once: one for each processor but the caller's, at least one */
  bool hosted; /* the threads are the host's, by `runner` */
  pags_runner runner;
  hand *crew;          /* [workers]; entry 0 is the caller */
  pags_arena **arenas; /* [workers] */
  loop loop;           /* written with the gate closed and nobody inside */
  pags_record *record; /* the record of the calling thread; NULL: none */

  /* Different sets of threads access these at high rates, hence each group has cache lines of its own. */
  _Alignas(64) atomic_uint gate;
  _Alignas(64) atomic_uint_fast64_t next_block;
  _Alignas(64) atomic_int cancelled;
  atomic_int sleepers;
  atomic_int queued; /* number of jobs in the list, readable without the lock */
  atomic_int stopping;

  _Alignas(64) pthread_mutex_t lock; /* guards the list and the jobs' states */
  pthread_cond_t wake;               /* for sleeping workers */
  pthread_cond_t left;               /* for a caller who waits for the count to fall to zero */
  pthread_cond_t job_done;
  pags_job *first_job, *last_job;
};

/* A stack, innermost entry first, of the pools in which this thread is working at the moment and its worker index in
 * each: by it a nested loop of the same pool is recognised and run inline. */
typedef struct inside {
  const pags_tasks *tasks;
  int worker;
  const struct inside *outer;
} inside;

static _Thread_local const inside *innermost;

static const inside *find_inside(const pags_tasks *tasks) {
  const inside *at = innermost;
  while (at && at->tasks != tasks)
    at = at->outer;
  return at;
}

/* Spins until `ready` returns true, for at most about SPIN_NANOSECONDS. Returns whether it did. */
static bool spin_until(bool (*ready)(pags_tasks *), pags_tasks *tasks) {
  int64_t deadline = 0;
  for (;;) {
    for (int i = 0; i < 32; ++i) {
      if (ready(tasks))
        return true;
#if defined(__x86_64__) || defined(__i386__)
      __builtin_ia32_pause();
#elif defined(__aarch64__)
      __asm__ volatile("yield");
#endif
    }
    int64_t now = pags_port_clock_ns();
    if (deadline == 0)
      deadline = now + SPIN_NANOSECONDS;
    else if (now >= deadline)
      return false;
  }
}

/* ---- Loops ---- */

static void run_block(const loop *l, uint64_t block, int worker) {
  int64_t begin = (int64_t)block * l->grain;
  int64_t end = l->grain < l->count - begin ? begin + l->grain : l->count;
  l->fn(l->context, begin, end, worker);
}

static void run_shared_blocks(pags_tasks *tasks, int worker) {
  const loop l = tasks->loop;
  while (!pags_tasks_cancelled(tasks)) {
    uint64_t block = atomic_fetch_add_explicit(&tasks->next_block, 1, memory_order_relaxed);
    if (block >= l.blocks)
      return;
    run_block(&l, block, worker);
  }
}

static void run_all_blocks(const pags_tasks *tasks, const loop *l, int worker) {
  for (uint64_t block = 0; block < l->blocks && !pags_tasks_cancelled(tasks); ++block)
    run_block(l, block, worker);
}

static bool nobody_inside(pags_tasks *tasks) {
  return (atomic_load(&tasks->gate) & GATE_COUNT) == 0;
}

/* Adds the calling worker to the count in the gate; false if there is no loop to join. */
static bool enter_gate(pags_tasks *tasks) {
  unsigned seen = atomic_load(&tasks->gate);
  while (seen & GATE_OPEN)
    if (atomic_compare_exchange_weak(&tasks->gate, &seen, seen + 1))
      return true;
  return false;
}

/* Closes the gate, since no block is left for others, and takes the calling worker off the count. While it is
 * counted, the loop cannot end, so that it is its own loop that it closes, not the next. */
static void leave_gate(pags_tasks *tasks) {
  atomic_fetch_and(&tasks->gate, ~GATE_OPEN);
  unsigned before = atomic_fetch_sub(&tasks->gate, 1);
  if ((before & GATE_AWAITED) && (before & GATE_COUNT) == 1) {
    pthread_mutex_lock(&tasks->lock);
    pthread_cond_signal(&tasks->left);
    pthread_mutex_unlock(&tasks->lock);
  }
}

static void close_gate(pags_tasks *tasks) {
  atomic_fetch_and(&tasks->gate, ~GATE_OPEN);
  if (spin_until(nobody_inside, tasks))
    return;
  pthread_mutex_lock(&tasks->lock);
  atomic_fetch_or(&tasks->gate, GATE_AWAITED);
  while (!nobody_inside(tasks))
    pthread_cond_wait(&tasks->left, &tasks->lock);
  atomic_fetch_and(&tasks->gate, ~GATE_AWAITED);
  pthread_mutex_unlock(&tasks->lock);
}

/* The number of workers, besides the caller, that work, spin, or are about to. */
static int awake(pags_tasks *tasks) {
  return tasks->workers - 1 - atomic_load(&tasks->sleepers);
}

/* Wakes up to `wanted` sleeping workers for work that has just become visible. A worker that is about to sleep takes
 * the lock, counts itself in `sleepers` and then looks for work: either it sees the work, or it is counted here, and
 * taking the lock here waits until it has released it by waiting on the condition, so that it receives the signal. */
static void wake_sleepers(pags_tasks *tasks, uint64_t wanted) {
  int sleepers = atomic_load(&tasks->sleepers);
  if (sleepers == 0)
    return;
  pthread_mutex_lock(&tasks->lock);
  pthread_mutex_unlock(&tasks->lock);
  if (wanted >= (uint64_t)sleepers) {
    pthread_cond_broadcast(&tasks->wake);
  } else {
    for (uint64_t i = 0; i < wanted; ++i)
      pthread_cond_signal(&tasks->wake);
  }
}

/* Wakes as many for it as are of use. */
static void wake_useful(pags_tasks *tasks, uint64_t wanted) {
  const int room = tasks->useful - awake(tasks);
  if (room > 0)
    wake_sleepers(tasks, wanted < (uint64_t)room ? wanted : (uint64_t)room);
}

static void host_entry(void *argument, int worker) {
  pags_tasks *tasks = argument;
  assert(worker >= 0 && worker < tasks->workers);
  const inside here = {tasks, worker, innermost};
  innermost = &here;
  run_shared_blocks(tasks, worker);
  innermost = here.outer;
}

static void run_loop(pags_tasks *tasks, const loop *l) {
  if (tasks->workers == 1 || l->blocks == 1) {
    run_all_blocks(tasks, l, 0);
    return;
  }
  tasks->loop = *l;
  atomic_store_explicit(&tasks->next_block, 0, memory_order_relaxed);
  if (tasks->hosted) {
    tasks->runner.run(tasks->runner.user, host_entry, tasks);
    return;
  }
  atomic_store(&tasks->gate, GATE_OPEN);
  wake_useful(tasks, tasks->loop.blocks - 1);
  run_shared_blocks(tasks, 0);
  close_gate(tasks);
}

/* Runs a loop and records it, block by block if this thread runs all of them. */
static void run_recorded(pags_tasks *tasks, const loop *l) {
  pags_record *const record = tasks->record;
  pags_record_end(record, PAGS_EVENT_SERIAL);
  const int64_t begin = record->last, before = record->blocks;
  if (tasks->workers == 1) {
    for (uint64_t block = 0; block < l->blocks && !pags_tasks_cancelled(tasks); ++block) {
      run_block(l, block, 0);
      pags_record_block(record);
    }
  } else {
    run_loop(tasks, l);
  }
  pags_record_loop(record, begin, record->blocks - before);
}

bool pags_parallel_for(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn, void *context) {
  assert(grain > 0 && fn);
  if (count <= 0)
    return !pags_tasks_cancelled(tasks);
  const loop l = {count, grain, (uint64_t)(count / grain) + (count % grain != 0), fn, context};
  const inside *already = find_inside(tasks);
  if (already) {
    run_all_blocks(tasks, &l, already->worker);
    return !pags_tasks_cancelled(tasks);
  }
  const inside here = {tasks, 0, innermost};
  innermost = &here;
  if (tasks->record)
    run_recorded(tasks, &l);
  else
    run_loop(tasks, &l);
  innermost = here.outer;
  return !pags_tasks_cancelled(tasks);
}

void pags_tasks_record(pags_tasks *tasks, pags_record *record) {
  if (tasks->record)
    pags_record_end(tasks->record, PAGS_EVENT_SERIAL);
  tasks->record = record;
  if (record)
    record->last = pags_port_clock_ns();
}

void pags_tasks_mark(pags_tasks *tasks, const char *phase, const char *stage) {
  if (!tasks->record || find_inside(tasks))
    return;
  pags_record_end(tasks->record, PAGS_EVENT_SERIAL);
  if (phase) {
    tasks->record->phase = phase;
    tasks->record->begins = true;
  }
  tasks->record->stage = stage;
}

void pags_tasks_cancel(pags_tasks *tasks) {
  atomic_store(&tasks->cancelled, 1);
}

void pags_tasks_reset(pags_tasks *tasks) {
  atomic_store(&tasks->cancelled, 0);
}

bool pags_tasks_cancelled(const pags_tasks *tasks) {
  return atomic_load_explicit(&tasks->cancelled, memory_order_relaxed) != 0;
}

/* ---- Jobs ---- */

/* Takes `job` out of the list and runs it. The lock is held at entry and at return, but not while the job runs. Once
 * its state is JOB_DONE the job belongs to the submitter again and must not be accessed here. */
static void run_job_locked(pags_tasks *tasks, pags_job *job) {
  pags_job *previous = NULL;
  for (pags_job *at = tasks->first_job; at != job; at = at->next)
    previous = at;
  *(previous ? &previous->next : &tasks->first_job) = job->next;
  if (tasks->last_job == job)
    tasks->last_job = previous;
  atomic_fetch_sub(&tasks->queued, 1);
  job->state = JOB_RUNNING;
  pthread_mutex_unlock(&tasks->lock);
  job->run(job->context);
  pthread_mutex_lock(&tasks->lock);
  job->state = JOB_DONE;
  pthread_cond_broadcast(&tasks->job_done);
}

static bool run_next_job(pags_tasks *tasks) {
  if (atomic_load(&tasks->queued) == 0)
    return false;
  pthread_mutex_lock(&tasks->lock);
  pags_job *job = tasks->first_job;
  if (job)
    run_job_locked(tasks, job);
  pthread_mutex_unlock(&tasks->lock);
  return job != NULL;
}

void pags_job_submit(pags_tasks *tasks, pags_job *job) {
  assert(job->run);
  pthread_mutex_lock(&tasks->lock);
  assert(job->state == JOB_IDLE || job->state == JOB_DONE);
  job->next = NULL;
  job->state = JOB_QUEUED;
  *(tasks->last_job ? &tasks->last_job->next : &tasks->first_job) = job;
  tasks->last_job = job;
  atomic_fetch_add(&tasks->queued, 1);
  pthread_mutex_unlock(&tasks->lock);
  wake_useful(tasks, 1);
}

void pags_job_wait(pags_tasks *tasks, pags_job *job) {
  /* If the job runs on this thread, its loops run inline, as they do on a worker. */
  const inside *already = find_inside(tasks);
  const inside here = {tasks, already ? already->worker : 0, innermost};
  pags_record *const record = already ? NULL : tasks->record;
  if (record)
    pags_record_end(record, PAGS_EVENT_SERIAL);
  innermost = &here;
  pthread_mutex_lock(&tasks->lock);
  const bool to_do = job->state == JOB_QUEUED || job->state == JOB_RUNNING;
  if (job->state == JOB_QUEUED)
    run_job_locked(tasks, job);
  while (job->state == JOB_RUNNING)
    pthread_cond_wait(&tasks->job_done, &tasks->lock);
  job->state = JOB_IDLE;
  pthread_mutex_unlock(&tasks->lock);
  innermost = here.outer;
  if (record)
    pags_record_end(record, to_do ? PAGS_EVENT_JOB : PAGS_EVENT_SERIAL);
}

/* ---- Threads ---- */

static bool has_work(pags_tasks *tasks) {
  return (atomic_load(&tasks->gate) & GATE_OPEN) || atomic_load(&tasks->queued) != 0 || atomic_load(&tasks->stopping);
}

static void *worker_main(void *argument) {
  const hand *self = argument;
  pags_tasks *tasks = self->tasks;
  const inside here = {tasks, self->worker, NULL};
  innermost = &here;
  for (;;) {
    if (enter_gate(tasks)) {
      run_shared_blocks(tasks, self->worker);
      leave_gate(tasks);
    } else if (run_next_job(tasks)) {
      continue;
    } else if (atomic_load(&tasks->stopping)) {
      break;
    } else if (awake(tasks) > tasks->useful || !spin_until(has_work, tasks)) {
      pthread_mutex_lock(&tasks->lock);
      atomic_fetch_add(&tasks->sleepers, 1);
      while (!has_work(tasks))
        pthread_cond_wait(&tasks->wake, &tasks->lock);
      atomic_fetch_sub(&tasks->sleepers, 1);
      pthread_mutex_unlock(&tasks->lock);
    }
  }
  innermost = NULL;
  return NULL;
}

static pags_tasks *create_without_threads(int workers) {
  pags_tasks *tasks = pags_port_aligned_alloc(_Alignof(pags_tasks), sizeof *tasks);
  if (!tasks)
    return NULL;
  *tasks = (pags_tasks){.workers = workers};
  pthread_mutex_init(&tasks->lock, NULL);
  pthread_cond_init(&tasks->wake, NULL);
  pthread_cond_init(&tasks->left, NULL);
  pthread_cond_init(&tasks->job_done, NULL);
  tasks->arenas = calloc((size_t)workers, sizeof *tasks->arenas);
  bool complete = tasks->arenas != NULL;
  for (int i = 0; i < workers && complete; i++)
    complete = (tasks->arenas[i] = pags_arena_create()) != NULL;
  if (complete)
    return tasks;
  pags_tasks_destroy(tasks);
  return NULL;
}

pags_tasks *pags_tasks_create(int threads) {
  assert(threads >= 0);
  const int processors = pags_available_threads();
  pags_tasks *tasks = create_without_threads(threads > 0 ? threads : processors);
  if (!tasks)
    return NULL;
  tasks->useful = processors > 2 ? processors - 1 : 1;
  tasks->crew = calloc((size_t)tasks->workers, sizeof *tasks->crew);
  bool started = tasks->crew != NULL;
  /* With all signals blocked: signal handlers run on the threads of the program. */
  const pags_port_signals before = pags_port_block_signals();
  for (int i = 1; i < tasks->workers && started; i++) {
    hand *h = &tasks->crew[i];
    *h = (hand){.tasks = tasks, .worker = i};
    started = pthread_create(&h->thread, NULL, worker_main, h) == 0;
    tasks->started += started;
  }
  pags_port_restore_signals(&before);
  if (started)
    return tasks;
  pags_tasks_destroy(tasks);
  return NULL;
}

pags_tasks *pags_tasks_create_with_runner(const pags_runner *runner) {
  assert(runner && runner->run && runner->workers >= 1 && runner->workers <= 256);
  pags_tasks *tasks = create_without_threads(runner->workers);
  if (!tasks)
    return NULL;
  tasks->hosted = true;
  tasks->runner = *runner;
  return tasks;
}

void pags_tasks_destroy(pags_tasks *tasks) {
  if (!tasks)
    return;
  /* Jobs that are still queued run here; without threads of the pool, nobody else would run them. */
  const inside here = {tasks, 0, innermost};
  innermost = &here;
  while (run_next_job(tasks))
    continue;
  innermost = here.outer;
  atomic_store(&tasks->stopping, 1);
  wake_sleepers(tasks, UINT64_MAX);
  for (int i = 1; i <= tasks->started; ++i)
    pthread_join(tasks->crew[i].thread, NULL);
  for (int i = 0; tasks->arenas && i < tasks->workers; ++i)
    pags_arena_destroy(tasks->arenas[i]);
  pthread_cond_destroy(&tasks->job_done);
  pthread_cond_destroy(&tasks->left);
  pthread_cond_destroy(&tasks->wake);
  pthread_mutex_destroy(&tasks->lock);
  free(tasks->arenas);
  free(tasks->crew);
  pags_port_aligned_free(tasks);
}

int pags_tasks_workers(const pags_tasks *tasks) {
  return tasks->record && tasks->record->workers > tasks->workers ? tasks->record->workers : tasks->workers;
}

pags_arena *pags_tasks_arena(pags_tasks *tasks, int worker) {
  assert(worker >= 0 && worker < tasks->workers);
  return tasks->arenas[worker];
}
