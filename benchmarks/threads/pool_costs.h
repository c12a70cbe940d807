/* SPDX-License-Identifier: Apache-2.0 */
/* Measures what the replay has to know of the pool and of this machine. */
#ifndef PAGS_BENCHMARKS_POOL_COSTS_H
#define PAGS_BENCHMARKS_POOL_COSTS_H

#include "benchmarks/threads/replay.h"
#include "simd/kernels.h"

/* Two ends of a range: what is lost least and most. */
typedef struct pags_pool_costs {
  pags_replay_costs low_cost, high_cost;
  int cores;        /* processors of this process, which were measured together */
  double bandwidth; /* bytes per nanosecond that all cores together read */
} pags_pool_costs;

/* Measures for about a second. A cost that can't be measured on this machine, as the waking of many workers on two
 * cores, gets bounds that follow from what can. */
pags_result pags_pool_costs_measure(pags_pool_costs *out);

/* What the bare blending kernel is fed with: a faint splat on a pixel, just above its cut. */
extern const pags_splat pags_faint_splat;

/* The bare blending kernel: a block is this number of rasteriser steps on splats in registers. */
typedef struct pags_peak {
  const pags_kernels *kernels;
  int64_t steps;
  int degree;                           /* of the polynomial for 2^x: 3 or 5 */
  float kept[PAGS_REPLAY_MOST_WORKERS]; /* results per block, stored so that the compiler can't remove the work */
} pags_peak;
void pags_peak_blocks(void *context, int64_t begin, int64_t end, int worker);
/* Lanes a second that it computes on all workers at once, in one run of some milliseconds. */
double pags_peak_rate(pags_tasks *tasks, const pags_kernels *kernels, int degree);

/* Bytes per second that all workers together read; 0 if out of memory. */
double pags_read_bandwidth(pags_tasks *tasks);

#endif
