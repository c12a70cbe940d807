/* SPDX-License-Identifier: Apache-2.0 */
/* Replays loops event by event. The state between events is the clock and, for each worker, since when it has been
 * without work, which decides whether it spins or sleeps when the next loop begins. */
#include "benchmarks/threads/replay.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

const char *const pags_replay_limit_names[PAGS_REPLAY_LIMITS] = {
    "serial", "few blocks", "longest block", "tail", "fork and join", "wake-ups", "cores", "memory"};

static const char jobs_phase[] = "jobs", host_phase[] = "host";

/* ---- One loop ---- */

/* A worker in the heap of those that may take the next block, the one that is free first on top. */
typedef struct hand {
  double at;
  int worker;
} hand;

typedef struct crew {
  double idle_since[PAGS_REPLAY_MOST_WORKERS];
  bool woken_before; /* whether the last loop had to wake workers */
} crew;

static bool is_before(hand a, hand b) {
  return a.at < b.at || (a.at == b.at && a.worker < b.worker);
}

static void sift_down(hand *heap, int count, int i) {
  for (;;) {
    int least = i;
    for (int child = 2 * i + 1; child <= 2 * i + 2; child++)
      if (child < count && is_before(heap[child], heap[least]))
        least = child;
    if (least == i)
      return;
    const hand moving = heap[i];
    heap[i] = heap[least];
    heap[least] = moving;
    i = least;
  }
}

/* When each worker can take its first block of a loop that is called at `begin`. A worker that sleeps and is not woken
 * gets infinity. Returns the number of workers that are woken. */
static int gather(const crew *c, double begin, int workers, int64_t blocks, const pags_replay_costs *k, hand *heap) {
  int woken = 0;
  for (int w = 1; w < workers; w++) {
    double at = begin + k->fork;
    if (begin - c->idle_since[w] > k->spin)
      at = woken + 1 < blocks ? begin + k->wake + k->wake_next * woken++ : INFINITY;
    heap[w] = (hand){at, w};
  }
  heap[0] = (hand){begin + k->wake_call * woken, 0};
  return woken;
}

/* Returns when a loop of more than one block and worker that is called at `begin` is over. */
static double run_loop(crew *c, double begin, const int64_t *ns, int64_t blocks, int workers,
                       const pags_replay_costs *k) {
  hand heap[PAGS_REPLAY_MOST_WORKERS];
  double end[PAGS_REPLAY_MOST_WORKERS];
  c->woken_before = gather(c, begin, workers, blocks, k, heap) > 0;
  for (int w = 0; w < workers; w++)
    end[heap[w].worker] = isinf(heap[w].at) ? c->idle_since[heap[w].worker] : heap[w].at;
  for (int i = workers / 2; i >= 0; i--)
    sift_down(heap, workers, i);
  double counter = begin, last = begin;
  for (int64_t b = 0; b < blocks; b++) {
    const double from = fmax(heap[0].at, counter);
    counter = from + k->claim;
    heap[0].at = counter + (double)ns[b] * k->slow;
    end[heap[0].worker] = heap[0].at;
    last = fmax(last, heap[0].at);
    sift_down(heap, workers, 0);
  }
  memcpy(c->idle_since, end, (size_t)workers * sizeof *end);
  const bool caller_sleeps = last - end[0] > k->spin;
  return last + k->join + (caller_sleeps ? k->wake : 0);
}

/* As run_loop, and splits what the loop takes into its limits. Nothing of a loop on one worker is lost but the worker's
 * company. */
static double replay_loop(crew *c, double begin, const int64_t *ns, int64_t blocks, int workers,
                          const pags_replay_costs *k, double bytes, pags_replay_time *out) {
  double work = 0, longest = 0;
  for (int64_t b = 0; b < blocks; b++) {
    work += (double)ns[b];
    longest = fmax(longest, (double)ns[b]);
  }
  const double share = work / workers;
  double lost[PAGS_REPLAY_LIMITS] = {0}, end = begin + work;
  if (workers > 1 && blocks == 1) {
    lost[PAGS_REPLAY_FEW] = work - share;
  } else if (workers > 1) {
    const pags_replay_costs free_of_cost = {.slow = k->slow, .spin = INFINITY};
    crew fresh = {{0}, false};
    const double apart = k->slow * work / fmin(workers, (double)blocks), least = fmax(apart, k->slow * longest);
    const double alone = run_loop(&fresh, 0, ns, blocks, workers, &free_of_cost);
    end = run_loop(c, begin, ns, blocks, workers, k);
    lost[PAGS_REPLAY_CORES] = (k->slow - 1) * share;
    lost[PAGS_REPLAY_FEW] = apart - k->slow * share;
    lost[PAGS_REPLAY_LONGEST] = least - apart;
    lost[PAGS_REPLAY_TAIL] = alone - least;
    lost[c->woken_before ? PAGS_REPLAY_WAKE : PAGS_REPLAY_FORK] = end - begin - alone;
    const double moved =
        fmax(k->bandwidth > 0 ? bytes / (k->bandwidth * workers) : 0, k->together > 0 ? bytes / k->together : 0);
    lost[PAGS_REPLAY_MEMORY] = fmax(moved - (end - begin), 0);
    end += lost[PAGS_REPLAY_MEMORY];
  }
  out->total += end - begin;
  for (int i = 0; i < PAGS_REPLAY_LIMITS; i++)
    out->lost[i] += lost[i];
  return end;
}

/* ---- Stages ---- */

static const char *phase_of(const pags_event *e) {
  return e->kind == PAGS_EVENT_JOB ? jobs_phase : e->phase ? e->phase : host_phase;
}

static const char *stage_of(const pags_event *e) {
  return e->stage ? e->stage : "other";
}

static bool is_left_out(const pags_event *e) {
  return !strcmp(phase_of(e), host_phase);
}

static int find(const pags_replay_stage *stages, int count, const pags_event *e) {
  int i = 0;
  while (i < count && (strcmp(stages[i].phase, phase_of(e)) != 0 || strcmp(stages[i].stage, stage_of(e)) != 0))
    i++;
  return i;
}

static void add_event(const pags_record *record, const pags_event *e, pags_replay_stage *s) {
  if (e->kind == PAGS_EVENT_SERIAL) {
    s->serial += (double)e->ns;
    return;
  }
  double longest = 0;
  s->loops += e->kind == PAGS_EVENT_LOOP;
  s->blocks += e->kind == PAGS_EVENT_LOOP ? e->count : 1;
  for (int64_t b = e->first; e->kind == PAGS_EVENT_LOOP && b < e->first + e->count; b++) {
    s->work += (double)record->block_ns[b];
    longest = fmax(longest, (double)record->block_ns[b]);
  }
  if (e->kind == PAGS_EVENT_JOB) { /* all jobs are one loop */
    s->loops = 1;
    s->work += (double)e->ns;
    s->longest = fmax(s->longest, (double)e->ns);
  }
  s->longest += longest;
}

pags_result pags_replay_list(const pags_record *record, pags_replay_stage **stages, int *count) {
  int capacity = 0;
  *stages = NULL;
  *count = 0;
  for (int64_t i = 0; i < record->count; i++) {
    const pags_event *const e = record->events + i;
    if (is_left_out(e))
      continue;
    const int at = find(*stages, *count, e);
    if (at == *count && at == capacity) {
      capacity = capacity > 0 ? 2 * capacity : 32;
      pags_replay_stage *const larger = realloc(*stages, (size_t)capacity * sizeof *larger);
      if (!larger) {
        free(*stages);
        *stages = NULL;
        return pags_out_of_memory("%d stages", capacity);
      }
      *stages = larger;
    }
    if (at == *count)
      (*stages)[(*count)++] = (pags_replay_stage){.phase = phase_of(e), .stage = stage_of(e)};
    add_event(record, e, *stages + at);
  }
  return PAGS_OK;
}

/* Replays all jobs of a stage as one loop. */
static pags_result replay_jobs(const pags_record *record, const pags_replay_stage *stages, int count, int stage,
                               int workers, const pags_replay_costs *costs, pags_replay_time *out) {
  int64_t *const ns = malloc((size_t)(stages[stage].blocks + 1) * sizeof *ns), jobs = 0;
  if (!ns)
    return pags_out_of_memory("%lld jobs", (long long)stages[stage].blocks);
  for (int64_t i = 0; i < record->count; i++)
    if (record->events[i].kind == PAGS_EVENT_JOB && find(stages, count, record->events + i) == stage)
      ns[jobs++] = record->events[i].ns;
  crew c = {{0}, false};
  replay_loop(&c, 0, ns, jobs, workers, costs, stages[stage].bytes, out);
  free(ns);
  return PAGS_OK;
}

pags_result pags_replay_run(const pags_record *record, const pags_replay_stage *stages, int count, int workers,
                            const pags_replay_costs *costs, pags_replay_time *times) {
  assert(workers >= 1 && workers <= PAGS_REPLAY_MOST_WORKERS && costs->slow >= 1);
  crew c = {{0}, false};
  double now = 0;
  memset(times, 0, (size_t)count * sizeof *times);
  for (int64_t i = 0; i < record->count; i++) {
    const pags_event *const e = record->events + i;
    if (e->kind == PAGS_EVENT_JOB)
      continue;
    if (is_left_out(e)) {
      now += (double)e->ns;
      continue;
    }
    const int at = find(stages, count, e);
    if (e->kind == PAGS_EVENT_SERIAL) {
      now += (double)e->ns;
      times[at].total += (double)e->ns;
      times[at].lost[PAGS_REPLAY_SERIAL] += (double)e->ns * (1 - 1.0 / workers);
      continue;
    }
    /* The loop's part of the stage's bytes is its part of the stage's work. */
    double work = 0;
    for (int64_t b = e->first; b < e->first + e->count; b++)
      work += (double)record->block_ns[b];
    const double bytes = stages[at].work > 0 ? stages[at].bytes * work / stages[at].work : 0;
    now = replay_loop(&c, now, record->block_ns + e->first, e->count, workers, costs, bytes, times + at);
  }
  for (int s = 0; s < count; s++)
    if (!strcmp(stages[s].phase, jobs_phase))
      PAGS_TRY(replay_jobs(record, stages, count, s, workers, costs, times + s));
  return PAGS_OK;
}
