/* SPDX-License-Identifier: Apache-2.0 */
/* Costs of the pool, from the clock inside of blocks of known length: what lies between the call and the first block of
 * a worker that spins (fork) or sleeps (wake), what lies between the last block and the return (join), and how fast
 * many empty blocks are taken. Each is measured many times; the range is from the tenth to the ninetieth of a hundred,
 * or to the median where only that is wanted. */
#include "benchmarks/threads/pool_costs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "port/port.h"

enum { ROUNDS = 60, BLOCK_NS = 60000, PAUSE_NS = 300000, EMPTY_BLOCKS = 200000, STEPS = 1 << 17 };
enum { BANDWIDTH_BYTES = 256 << 20, BANDWIDTH_ROUNDS = 5 };
/* How long a thread of the pool spins before it sleeps, pool.c. */
static const double spin_ns = 40000;

static void spend(int64_t ns) {
  const int64_t end = pags_port_clock_ns() + ns;
  while (pags_port_clock_ns() < end)
    continue;
}

/* ---- Fork, join and waking ---- */

typedef struct clocks {
  int64_t begin[PAGS_REPLAY_MOST_WORKERS], end[PAGS_REPLAY_MOST_WORKERS]; /* per block */
  int worker[PAGS_REPLAY_MOST_WORKERS];
} clocks;

static void timed_block(void *context, int64_t begin, int64_t end, int worker) {
  clocks *const c = context;
  (void)end;
  c->begin[begin] = pags_port_clock_ns();
  c->worker[begin] = worker;
  spend(BLOCK_NS);
  c->end[begin] = pags_port_clock_ns();
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}

/* The percentile of the values; sorts them. */
static double percentile(double *values, int count, int hundredths) {
  if (count == 0)
    return 0;
  qsort(values, (size_t)count, sizeof *values, by_value);
  return values[(count - 1) * hundredths / 100];
}

typedef struct latencies {
  double first[ROUNDS], each[ROUNDS], caller[ROUNDS], join[ROUNDS];
  int count;
} latencies;

/* Calls loops of one block for each worker after `pause` without work: how long it takes to the first worker's block,
 * from there to each further one's, to the caller's own, and from the last block to the return. Rounds in which a
 * worker took two blocks don't count. */
static void measure_latencies(pags_tasks *tasks, int64_t pause, latencies *out) {
  const int workers = pags_tasks_workers(tasks);
  out->count = 0;
  for (int round = 0; round < ROUNDS; round++) {
    clocks c;
    int64_t first = INT64_MAX, last = 0, end = 0, caller = -1;
    bool seen[PAGS_REPLAY_MOST_WORKERS] = {false}, apart = true;
    spend(pause);
    const int64_t begin = pags_port_clock_ns();
    pags_parallel_for(tasks, workers, 1, timed_block, &c);
    const int64_t back = pags_port_clock_ns();
    for (int b = 0; b < workers; b++) {
      apart &= !seen[c.worker[b]];
      seen[c.worker[b]] = true;
      end = c.end[b] > end ? c.end[b] : end;
      if (c.worker[b] == 0) {
        caller = c.begin[b] - begin;
        continue;
      }
      first = c.begin[b] - begin < first ? c.begin[b] - begin : first;
      last = c.begin[b] - begin > last ? c.begin[b] - begin : last;
    }
    if (!apart || caller < 0)
      continue;
    out->first[out->count] = (double)first;
    out->each[out->count] = workers > 2 ? (double)(last - first) / (workers - 2) : 0;
    out->caller[out->count] = (double)caller / (workers - 1);
    out->join[out->count++] = (double)(back - end);
  }
}

static void empty_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)context, (void)begin, (void)end, (void)worker;
}

/* Nanoseconds between two blocks that are taken, with all workers at it. */
static double claim_time(pags_tasks *tasks) {
  double best = INFINITY;
  for (int round = 0; round < 5; round++) {
    const int64_t begin = pags_port_clock_ns();
    pags_parallel_for(tasks, EMPTY_BLOCKS, 1, empty_block, NULL);
    best = fmin(best, (double)(pags_port_clock_ns() - begin) / EMPTY_BLOCKS);
  }
  return best;
}

/* ---- Cores and memory ---- */

const pags_splat pags_faint_splat = {.x = 1,
                                     .y = 1,
                                     .p = 0.1f,
                                     .h = 0.1f,
                                     .w = 0.1f,
                                     .log2_opacity = -7.5f,
                                     .cut = -8.0f,
                                     .r = 0.5f,
                                     .g = 0.5f,
                                     .b = 0.5f};

void pags_peak_blocks(void *context, int64_t begin, int64_t end, int worker) {
  pags_peak *const c = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++)
    c->kept[i] = c->kernels->roofline(&pags_faint_splat, c->steps, c->degree);
}

double pags_peak_rate(pags_tasks *tasks, const pags_kernels *kernels, int degree) {
  const int workers = pags_tasks_workers(tasks);
  pags_peak c = {.kernels = kernels, .steps = 1 << 19, .degree = degree};
  const int64_t begin = pags_port_clock_ns();
  pags_parallel_for(tasks, workers, 1, pags_peak_blocks, &c);
  return (double)(c.steps * PAGS_LANES * workers) / (double)(pags_port_clock_ns() - begin) * 1e9;
}

/* Times as long as alone that the bare blending kernel takes while it runs on all cores: below what is lost to shared
 * clocks, and to cores that are two threads of one. */
static double slowness(pags_tasks *tasks, pags_peak *peak) {
  double alone = INFINITY, together = INFINITY;
  const int workers = pags_tasks_workers(tasks);
  for (int round = 0; round < 10; round++) {
    int64_t begin = pags_port_clock_ns();
    pags_peak_blocks(peak, 0, 1, 0);
    alone = fmin(alone, (double)(pags_port_clock_ns() - begin));
    begin = pags_port_clock_ns();
    pags_parallel_for(tasks, workers, 1, pags_peak_blocks, peak);
    together = fmin(together, (double)(pags_port_clock_ns() - begin));
  }
  return fmax(together / alone, 1);
}

typedef struct read_context {
  const uint64_t *data;
  uint64_t *sums;
} read_context;

static void read_block(void *context, int64_t begin, int64_t end, int worker) {
  const read_context *const c = context;
  uint64_t a = 0, b = 0, d = 0, e = 0;
  for (int64_t i = begin; i + 4 <= end; i += 4)
    a += c->data[i], b += c->data[i + 1], d += c->data[i + 2], e += c->data[i + 3];
  c->sums[worker] += a + b + d + e;
}

double pags_read_bandwidth(pags_tasks *tasks) {
  const int64_t count = BANDWIDTH_BYTES / 8;
  uint64_t *const data = malloc(BANDWIDTH_BYTES);
  if (!data)
    return 0;
  memset(data, 1, BANDWIDTH_BYTES);
  uint64_t sums[256] = {0};
  read_context c = {data, sums};
  double best = 0;
  for (int i = 0; i < BANDWIDTH_ROUNDS; i++) {
    const int64_t begin = pags_port_clock_ns();
    pags_parallel_for(tasks, count, 1 << 16, read_block, &c);
    best = fmax(best, (double)BANDWIDTH_BYTES / (double)(pags_port_clock_ns() - begin) * 1e9);
  }
  free(data);
  return best;
}

/* ---- All of them ---- */

static void measure(pags_tasks *tasks, pags_peak *peak, pags_pool_costs *out) {
  latencies spinning, sleeping;
  measure_latencies(tasks, 0, &spinning);
  measure_latencies(tasks, PAUSE_NS, &sleeping);
  pags_replay_costs *const least = &out->low_cost, *const most = &out->high_cost;
  *least = *most = (pags_replay_costs){.spin = spin_ns, .slow = 1};
  least->fork = percentile(spinning.first, spinning.count, 50),
  most->fork = percentile(spinning.first, spinning.count, 90);
  least->join = percentile(spinning.join, spinning.count, 50),
  most->join = percentile(spinning.join, spinning.count, 90);
  least->wake = percentile(sleeping.first, sleeping.count, 50),
  most->wake = percentile(sleeping.first, sleeping.count, 90);
  least->wake_call = percentile(sleeping.caller, sleeping.count, 50);
  most->wake_call = percentile(sleeping.caller, sleeping.count, 90);
  if (out->cores > 2) {
    least->wake_next = percentile(sleeping.each, sleeping.count, 50);
    most->wake_next = percentile(sleeping.each, sleeping.count, 90);
  } else {
    /* Woken threads run one after the other at the latest, since they take the pool's lock in turn; at the earliest as
     * fast as the caller wakes them. */
    least->wake_next = least->wake_call;
    most->wake_next = most->wake;
  }
  /* Workers of one socket pass the counter on as fast as the cores here do; of two, several times as slowly. */
  least->claim = claim_time(tasks);
  most->claim = 3 * least->claim;
  most->slow = slowness(tasks, peak);
  least->slow = sqrt(most->slow);
  out->bandwidth = pags_read_bandwidth(tasks) * 1e-9;
  most->bandwidth = out->bandwidth / out->cores;
}

pags_result pags_pool_costs_measure(pags_pool_costs *out) {
  const char *why = "";
  pags_peak peak = {.kernels = pags_kernels_get(&why), .steps = STEPS, .degree = 5};
  *out = (pags_pool_costs){.cores = pags_available_threads()};
  if (!peak.kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  out->cores = out->cores < PAGS_REPLAY_MOST_WORKERS ? out->cores : PAGS_REPLAY_MOST_WORKERS;
  pags_tasks *const tasks = pags_tasks_create(out->cores);
  if (!tasks)
    return pags_out_of_memory("%d threads", out->cores);
  measure(tasks, &peak, out);
  pags_tasks_destroy(tasks);
  return PAGS_OK;
}
