/* SPDX-License-Identifier: Apache-2.0 */
/* check_scaling: compares the predictions of pags-bench scaling with measured times. It draws frames of a random
 * scene on two threads: unchanged, then with a serial delay of known length, then with one work item of a parallel loop
 * made four times as long. The delays are added to the record of one thread by arithmetic. Needs a quiet machine
 * with at least two cores, so it isn't part of make check (make check-scaling). Fails if the measured median lies more
 * than 5 % outside of the predicted range, or if the range is too wide to be useful because the machine is busy. */
#include <math.h>
#include <pags/clusters.h>
#include <pags/frame.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "benchmarks/threads/pool_costs.h"
#include "port/port.h"

enum { GAUSSIANS = 30000, WIDTH = 960, HEIGHT = 540, ROUNDS = 41, BLOCKS = 8 };
static const int64_t block_ns = 8000000; /* long compared with a frame, so that one block more or less is visible */

typedef enum way { PLAIN, SERIAL_BLOCK, LONG_BLOCK, WAYS } way;
static const char *const way_names[WAYS] = {"frames", "a block made serial", "a block four times as long"};

typedef struct check {
  pags_gaussians rows;
  pags_clusters clusters;
  pags_camera camera;
  way way;
} check;

static _Noreturn void stop(const char *why) {
  fprintf(stderr, "check_scaling: %s\n", why);
  exit(1);
}

static void spend(int64_t ns) {
  const int64_t end = pags_port_clock_ns() + ns;
  while (pags_port_clock_ns() < end)
    continue;
}

static float uniform(uint64_t *state) { /* 0..1 */
  *state = *state * 6364136223846793005u + 1442695040888963407u;
  return (float)(*state >> 40) * 0x1p-24f;
}

static void make_scene(check *c) {
  uint64_t random = 1;
  if (pags_gaussians_create(&c->rows, GAUSSIANS, 1) != PAGS_OK)
    stop("out of memory");
  for (int64_t i = 0; i < GAUSSIANS; i++) {
    const float z = 4.0f + 40.0f * uniform(&random);
    pags_plane(&c->rows, PAGS_MEAN)[i] = z * (uniform(&random) - 0.5f);
    pags_plane(&c->rows, PAGS_MEAN + 1)[i] = 0.6f * z * (uniform(&random) - 0.5f);
    pags_plane(&c->rows, PAGS_MEAN + 2)[i] = z;
    for (int k = 0; k < 3; k++) {
      pags_plane(&c->rows, PAGS_SCALE + k)[i] = -3.5f + uniform(&random);
      pags_plane(&c->rows, PAGS_SH + k)[i] = uniform(&random);
    }
    pags_plane(&c->rows, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(&c->rows, PAGS_OPACITY)[i] = -2.0f;
  }
  if (pags_clusters_create(&c->clusters, GAUSSIANS, 64) != PAGS_OK)
    stop("out of memory");
  pags_clusters_update(&c->clusters, &c->rows, 0, c->clusters.count);
  c->camera =
      (pags_camera){.width = WIDTH, .height = HEIGHT, .fx = WIDTH, .fy = WIDTH, .cx = WIDTH / 2, .cy = HEIGHT / 2};
  for (int k = 0; k < 3; k++)
    c->camera.world_from_camera[5 * k] = 1;
}

static void slow_block(void *context, int64_t begin, int64_t end, int worker) {
  const check *const c = context;
  (void)worker;
  for (int64_t b = begin; b < end; b++)
    spend(c->way == LONG_BLOCK && b == BLOCKS - 1 ? 4 * block_ns : block_ns);
}

/* Draws a frame, then a loop of blocks of known length. */
static void run(const check *c, pags_tasks *tasks, pags_frame *frame, bool with_blocks) {
  const pags_part part = {
      .gaussians = &c->rows, .clusters = &c->clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  pags_frame_options o = pags_frame_options_default();
  pags_picture picture;
  o.early_z = PAGS_EARLY_Z_OFF;
  pags_tasks_mark(tasks, "frame", "compose");
  if (pags_frame_render(frame, &part, 1, &c->camera, &o, NULL, NULL, &picture) != PAGS_OK)
    stop(pags_error_message());
  if (c->way == SERIAL_BLOCK)
    spend(block_ns);
  if (with_blocks)
    pags_parallel_for(tasks, c->way == SERIAL_BLOCK ? BLOCKS - 1 : BLOCKS, 1, slow_block, (void *)c);
}

/* Adds the time of the blocks that `run` draws after a frame to the frame's record. */
static void slow_down(const check *c, pags_record *r, pags_event events[], int64_t *ns) {
  const int blocks = c->way == SERIAL_BLOCK ? BLOCKS - 1 : BLOCKS;
  memcpy(events, r->events, (size_t)r->count * sizeof *events);
  memcpy(ns, r->block_ns, (size_t)r->blocks * sizeof *ns);
  if (c->way == SERIAL_BLOCK)
    events[r->count++] = (pags_event){.kind = PAGS_EVENT_SERIAL, .phase = "frame", .stage = "slowed", .ns = block_ns};
  events[r->count++] =
      (pags_event){.kind = PAGS_EVENT_LOOP, .phase = "frame", .stage = "slowed", .first = r->blocks, .count = blocks};
  for (int b = 0; b < blocks; b++)
    ns[r->blocks++] = c->way == LONG_BLOCK && b == BLOCKS - 1 ? 4 * block_ns : block_ns;
}

static double predict(const check *c, const pags_record *alone, const pags_replay_costs *costs) {
  pags_record r = *alone;
  pags_replay_stage *stages = NULL;
  int count = 0;
  double sum = 0;
  r.events = malloc((size_t)(r.count + 2) * sizeof *r.events);
  r.block_ns = malloc((size_t)(r.blocks + BLOCKS) * sizeof *r.block_ns);
  if (!r.events || !r.block_ns)
    stop("out of memory");
  pags_event *const events = r.events;
  int64_t *const ns = r.block_ns;
  r.events = alone->events, r.block_ns = alone->block_ns;
  slow_down(c, &r, events, ns);
  r.events = events, r.block_ns = ns;
  if (pags_replay_list(&r, &stages, &count) != PAGS_OK)
    stop("out of memory");
  pags_replay_time *const times = malloc((size_t)count * sizeof *times);
  if (!times || pags_replay_run(&r, stages, count, 2, costs, times) != PAGS_OK)
    stop("out of memory");
  for (int i = 0; i < count; i++)
    sum += times[i].total;
  free(times);
  free(stages);
  free(events);
  free(ns);
  return sum;
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return x < y ? -1 : x > y;
}

static double median(double *values) {
  qsort(values, ROUNDS, sizeof *values, by_value);
  return values[ROUNDS / 2];
}

/* Returns whether the measured time lies in the predicted range widened by 5 %. Records and measures in turn, so
 * that other work on the machine affects both. */
static bool holds(check *c, pags_tasks *const tasks[2], pags_frame *const frames[2], const pags_pool_costs *costs) {
  double least[ROUNDS], most[ROUNDS], measured[ROUNDS];
  for (int i = 0; i < ROUNDS; i++) {
    pags_record alone = {0};
    const way slowed = c->way;
    c->way = PLAIN;
    pags_tasks_record(tasks[0], &alone);
    run(c, tasks[0], frames[0], false);
    pags_tasks_record(tasks[0], NULL);
    c->way = slowed;
    least[i] = predict(c, &alone, &costs->low_cost);
    most[i] = predict(c, &alone, &costs->high_cost);
    pags_record_destroy(&alone);
    const int64_t begin = pags_port_clock_ns();
    run(c, tasks[1], frames[1], true);
    measured[i] = (double)(pags_port_clock_ns() - begin);
  }
  const double a = median(least), b = median(most), m = median(measured);
  const double off = m < a ? 1 - m / a : m > b ? m / b - 1 : 0;
  printf("%-28s predicted %7.3f to %7.3f ms, measured %7.3f ms on 2 threads: %4.1f %% outside\n", way_names[c->way],
         a * 1e-6, b * 1e-6, m * 1e-6, 100 * off);
  return off <= 0.05 && b <= 1.2 * a;
}

int main(void) {
  check c = {.way = PLAIN};
  pags_pool_costs costs;
  pags_tasks *const tasks[2] = {pags_tasks_create(1), pags_tasks_create(2)};
  pags_frame *frames[2];
  if (pags_available_threads() < 2)
    stop("needs two cores");
  for (int i = 0; i < 2; i++)
    if (!tasks[i] || pags_frame_create(tasks[i], &frames[i]) != PAGS_OK)
      stop("out of memory");
  make_scene(&c);
  if (pags_pool_costs_measure(&costs) != PAGS_OK)
    stop(pags_error_message());
  bool right = true;
  for (int k = 0; k < WAYS; k++) {
    c.way = (way)k;
    right &= holds(&c, tasks, frames, &costs);
  }
  for (int i = 0; i < 2; i++) {
    pags_frame_destroy(frames[i]);
    pags_tasks_destroy(tasks[i]);
  }
  pags_clusters_destroy(&c.clusters);
  pags_gaussians_destroy(&c.rows);
  if (!right)
    fprintf(stderr,
            "check_scaling: a prediction is more than 5 %% off or its range wider than 20 %%; is the machine quiet?\n");
  return right ? 0 : 1;
}
