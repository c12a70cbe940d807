/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the record of a thread pool's work and the prediction of its time for other numbers of workers. Handmade
 * records have exactly known times; the record of real loops is checked for its contents. */
#include "benchmarks/threads/replay.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define assert_ns(found, expected) assert_true(fabs((found) - (expected)) < 1e-6)

static const pags_replay_costs no_costs = {.spin = 1e18, .slow = 1};

/* A record of one stage: a serial part (0: none), then a loop over the blocks. */
typedef struct made {
  pags_event events[64];
  int64_t ns[256];
  pags_record record;
} made;

static void begin(made *m) {
  memset(m, 0, sizeof *m);
  m->record = (pags_record){.events = m->events, .block_ns = m->ns};
}

static void add_serial(made *m, const char *stage, int64_t ns) {
  m->events[m->record.count++] = (pags_event){.kind = PAGS_EVENT_SERIAL, .phase = "step", .stage = stage, .ns = ns};
}

static void add_loop(made *m, const char *stage, const int64_t *ns, int64_t count) {
  m->events[m->record.count++] =
      (pags_event){.kind = PAGS_EVENT_LOOP, .phase = "step", .stage = stage, .first = m->record.blocks, .count = count};
  for (int64_t i = 0; i < count; i++)
    m->ns[m->record.blocks++] = ns[i];
}

/* The predicted time of the record's only stage. */
static pags_replay_time predict(const made *m, int workers, const pags_replay_costs *costs, double bytes) {
  pags_replay_stage *stages;
  pags_replay_time time;
  int count;
  assert_int_equal(pags_replay_list(&m->record, &stages, &count), PAGS_OK);
  assert_int_equal(count, 1);
  stages[0].bytes = bytes;
  assert_int_equal(pags_replay_run(&m->record, stages, count, workers, costs, &time), PAGS_OK);
  /* The work's share and all losses add up to the predicted time. */
  double sum = (stages[0].serial + stages[0].work) / workers;
  for (int k = 0; k < PAGS_REPLAY_LIMITS; k++)
    sum += time.lost[k];
  assert_ns(sum, time.total);
  free(stages);
  return time;
}

/* A worker that is free takes the next block. */
static void blocks_are_taken_in_order(void **state) {
  (void)state;
  made m;
  begin(&m);
  add_loop(&m, "raster", (const int64_t[]){3000, 1000, 1000, 1000, 4000}, 5);
  assert_ns(predict(&m, 1, &no_costs, 0).total, 10000);
  /* Worker 0 runs the blocks of 3 and 4; worker 1 those of 1, 1 and 1. The loop ends at 7, not at 5. */
  const pags_replay_time two = predict(&m, 2, &no_costs, 0);
  assert_ns(two.total, 7000);
  assert_ns(two.lost[PAGS_REPLAY_TAIL], 2000);
  /* Worker 0 runs the block of 3, worker 1 those of 1 and 1, worker 2 those of 1 and 4. The loop ends at 5. */
  const pags_replay_time three = predict(&m, 3, &no_costs, 0);
  assert_ns(three.total, 5000);
  assert_ns(three.lost[PAGS_REPLAY_LONGEST], 4000 - 10000 / 3.0);
  const pags_replay_time many = predict(&m, 10, &no_costs, 0);
  assert_ns(many.total, 4000);
  assert_ns(many.lost[PAGS_REPLAY_FEW], 1000); /* 10000 / 5 instead of / 10 */
  assert_ns(many.lost[PAGS_REPLAY_LONGEST], 2000);
}

/* A run that is slowed on purpose, by a serial block of known length and by a block of four times the length, has
 * the predicted time. */
static void known_slowness_is_predicted(void **state) {
  (void)state;
  int64_t even[64];
  for (int i = 0; i < 64; i++)
    even[i] = 1000;
  made m;
  begin(&m);
  add_loop(&m, "raster", even, 64);
  assert_ns(predict(&m, 16, &no_costs, 0).total, 4000);

  begin(&m);
  add_serial(&m, "raster", 1000);
  add_loop(&m, "raster", even, 63);
  const pags_replay_time serial = predict(&m, 16, &no_costs, 0);
  assert_ns(serial.total, 1000 + 4000);
  assert_ns(serial.lost[PAGS_REPLAY_SERIAL], 1000 * 15 / 16.0);

  even[63] =
      4000; /* the long block is the last and begins when the others are done, except for 15 blocks of the last round */
  begin(&m);
  add_loop(&m, "raster", even, 64);
  assert_ns(predict(&m, 16, &no_costs, 0).total, 3000 + 4000);
  even[63] = 1000, even[0] = 4000; /* the long block is the first, and the others fill its time */
  begin(&m);
  add_loop(&m, "raster", even, 64);
  assert_ns(predict(&m, 16, &no_costs, 0).total, 5000);
}

static void costs_are_added(void **state) {
  (void)state;
  made m;
  const pags_replay_costs costs = {.fork = 100, .join = 10, .spin = 5000, .slow = 1};
  begin(&m);
  add_loop(&m, "raster", (const int64_t[]){1000, 1000}, 2);
  assert_ns(predict(&m, 2, &costs, 0).total, 1110); /* the other worker begins 100 ns later */
  assert_ns(predict(&m, 1, &costs, 0).total, 2000); /* one worker alone doesn't start late */

  /* A worker sleeps after 6000 ns without work, and the caller has to wake it. */
  const pags_replay_costs wakes = {
      .fork = 100, .join = 10, .spin = 5000, .wake_call = 50, .wake = 300, .wake_next = 70, .slow = 1};
  begin(&m);
  add_serial(&m, "raster", 6000);
  add_loop(&m, "raster", (const int64_t[]){1000, 1000, 1000}, 3);
  const pags_replay_time three = predict(&m, 3, &wakes, 0);
  assert_ns(three.total, 6000 + 300 + 70 + 1000 + 10);
  assert_ns(three.lost[PAGS_REPLAY_WAKE], 380);
  /* After 4000 ns the worker still spins. */
  m.events[0].ns = 4000;
  assert_ns(predict(&m, 3, &wakes, 0).total, 4000 + 100 + 1000 + 10);
  /* The loop doesn't wait for a worker that wakes after all blocks are taken. */
  const pags_replay_costs slow_to_wake = {.spin = 5000, .wake = 1e6, .slow = 1};
  m.events[0].ns = 6000;
  assert_ns(predict(&m, 3, &slow_to_wake, 0).total, 6000 + 3000);
  /* A loop of two blocks wakes only one worker; the third continues to sleep. */
  begin(&m);
  add_serial(&m, "raster", 6000);
  add_loop(&m, "raster", (const int64_t[]){1000, 1000}, 2);
  add_loop(&m, "raster", (const int64_t[]){1000, 1000, 1000}, 3);
  assert_ns(predict(&m, 3, &wakes, 0).total, 6000 + (300 + 1000 + 10) + (300 + 1000 + 10));
}

static void claims_and_memory_bound(void **state) {
  (void)state;
  int64_t small[200];
  for (int i = 0; i < 200; i++)
    small[i] = 100;
  made m;
  begin(&m);
  add_loop(&m, "bin", small, 200);
  /* With 50 workers, blocks of 100 ns and a counter that each worker holds for 10 ns, only 11 blocks run at the same
   * time. */
  const pags_replay_costs claims = {.claim = 10, .spin = 1e18, .slow = 1};
  assert_ns(predict(&m, 50, &claims, 0).total, 200 * 10 + 100);
  const pags_replay_costs memory = {.bandwidth = 0.5, .spin = 1e18, .slow = 1};
  assert_ns(predict(&m, 50, &memory, 0).total, 400);
  const pags_replay_time bound = predict(&m, 50, &memory, 50000); /* 50000 bytes at 25 bytes a nanosecond */
  assert_ns(bound.total, 2000);
  assert_ns(bound.lost[PAGS_REPLAY_MEMORY], 1600);
  const pags_replay_costs cores = {.spin = 1e18, .slow = 1.25};
  assert_ns(predict(&m, 50, &cores, 0).total, 500);
  assert_ns(predict(&m, 1, &cores, 0).total, 20000);
}

static void jobs_are_a_loop(void **state) {
  (void)state;
  made m;
  pags_replay_stage *stages;
  pags_replay_time times[2];
  int count;
  begin(&m);
  for (int i = 0; i < 3; i++) {
    add_serial(&m, "photograph", 10);
    m.events[m.record.count++] =
        (pags_event){.kind = PAGS_EVENT_JOB, .phase = "step", .stage = "photograph", .ns = 500};
  }
  m.events[m.record.count++] = (pags_event){.kind = PAGS_EVENT_SERIAL, .phase = "host", .ns = 7000};
  assert_int_equal(pags_replay_list(&m.record, &stages, &count), PAGS_OK);
  assert_int_equal(count, 2);
  assert_string_equal(stages[1].phase, "jobs");
  assert_int_equal(pags_replay_run(&m.record, stages, count, 2, &no_costs, times), PAGS_OK);
  assert_ns(times[0].total, 30);
  assert_ns(times[1].total, 1000);
  free(stages);
}

/* ---- The recorder ---- */

typedef struct work {
  pags_tasks *tasks;
  int blocks;
} work;

static void inner(void *context, int64_t first, int64_t end, int worker) {
  (void)context, (void)first, (void)end, (void)worker;
}

static void outer(void *context, int64_t first, int64_t end, int worker) {
  work *w = context;
  (void)first, (void)end, (void)worker;
  pags_tasks_mark(w->tasks, "inside", "a block"); /* no effect there */
  pags_parallel_for(w->tasks, 5, 1, inner, NULL);
}

static void run_job(void *context) {
  work *w = context;
  w->blocks++;
  pags_parallel_for(w->tasks, 5, 1, inner, NULL);
}

static void record_some(pags_tasks *tasks, pags_record *r) {
  work w = {.tasks = tasks};
  pags_job job = {.run = run_job, .context = &w};
  pags_tasks_record(tasks, r);
  pags_tasks_mark(tasks, "step", "bin");
  assert_true(pags_parallel_for(tasks, 7, 2, outer, &w));
  pags_tasks_mark(tasks, NULL, "sort");
  assert_true(pags_parallel_for(tasks, 3, 1, outer, &w));
  pags_tasks_mark(tasks, "prune", "scores");
  pags_job_submit(tasks, &job);
  pags_job_wait(tasks, &job);
  pags_tasks_record(tasks, NULL);
  assert_true(pags_parallel_for(tasks, 7, 2, outer, &w)); /* no longer recorded */
  assert_int_equal(w.blocks, 1);
}

static void loops_are_recorded(void **state) {
  (void)state;
  for (int threads = 1; threads <= 4; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    pags_record r = {0};
    assert_non_null(tasks);
    record_some(tasks, &r);
    int64_t loops = 0, begins = 0, blocks = 0;
    for (int64_t i = 0; i < r.count; i++) {
      const pags_event *e = r.events + i;
      assert_true(e->ns > 0 || e->kind == PAGS_EVENT_LOOP);
      begins += e->begins;
      blocks += e->kind == PAGS_EVENT_LOOP ? e->count : 0;
      if (e->kind == PAGS_EVENT_LOOP && loops++ == 0) {
        assert_string_equal(e->stage, "bin");
        assert_int_equal(e->count, threads == 1 ? 4 : 0);
      }
      if (e->kind == PAGS_EVENT_JOB)
        assert_string_equal(e->phase, "prune");
      if (e->phase)
        assert_string_not_equal(e->phase, "inside");
    }
    assert_int_equal(loops, 2);
    assert_int_equal(begins, 2);
    assert_int_equal(blocks, threads == 1 ? 7 : 0);
    assert_int_equal(r.blocks, blocks);
    assert_false(r.lost);
    pags_record_destroy(&r);
    pags_tasks_destroy(tasks);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(blocks_are_taken_in_order), cmocka_unit_test(known_slowness_is_predicted),
      cmocka_unit_test(costs_are_added),           cmocka_unit_test(claims_and_memory_bound),
      cmocka_unit_test(jobs_are_a_loop),           cmocka_unit_test(loops_are_recorded),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
