/* SPDX-License-Identifier: Apache-2.0 */
/* Adam whose cost follows the clusters in view, with the results of Adam over everything at every step.
 *
 * A cluster that no view shows owes updates: its moments still move its parameters. `touch` pays what is owed before
 * the members are read; `update` pays too and adds a step with gradients. Each owed step is rounded by itself from
 * moments that only a gradient changes, so paying early, late or in pieces gives the same bits, and so does a cluster
 * that is touched but shows nothing. */
#ifndef PAGS_TRAIN_ADAM_H
#define PAGS_TRAIN_ADAM_H

#include <pags/frame.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "train/nonfinite.h"
#include "train/schedule.h"

struct pags_kernels;

typedef struct pags_adam {
  const pags_schedule *schedule;
  const struct pags_kernels *kernels;
  pags_gaussians first, second; /* moments, rows as the parameters' */
  int cluster_size;
  int64_t cluster_count, cluster_capacity;
  int32_t *moment_step; /* per cluster: the step of its last gradient */
  int32_t *param_step;  /* per cluster: the step its parameters are current as of, >= moment_step */
  int64_t table_steps;  /* entries of the two tables, by step */
  double *correction;   /* c_k = sqrt(1 - beta2^k) / (1 - beta1^k) */
  double *position_rate;
  int reach;                         /* steps after a gradient until its momentum is spent: q^reach < 1e-9 */
  double *decay;                     /* q^j, j = 0 .. reach, q = beta1 / sqrt(beta2) */
  int64_t step;                      /* of the updates under way */
  double reach_position, reach_unit; /* sums over j >= 1 of rate c_(step+j) q^j: the positions' rate, and rate 1 */
} pags_adam;

/* For parameters `g` of zero moments, all current as of `step`. `last_step` is the largest step there will be. */
pags_result pags_adam_create(pags_adam *adam, const pags_schedule *schedule, const pags_gaussians *g, int64_t step,
                             int64_t last_step);
void pags_adam_destroy(pags_adam *adam);
/* Room for more rows, as pags_gaussians_reserve. */
pags_result pags_adam_reserve(pags_adam *adam, int64_t capacity);
/* After rows were added, removed or moved (moments with them): every cluster current as of `step`. */
pags_result pags_adam_regroup(pags_adam *adam, int64_t count, int64_t step);
/* New tables after the schedule changed; call with everything settled. */
pags_result pags_adam_retime(pags_adam *adam, int64_t last_step);

/* Once before the updates of a step: what all of them share. */
void pags_adam_begin(pags_adam *adam, int64_t step);
/* Brings the parameters of a cluster up to `step` - 1. Safe from several threads for different clusters. */
void pags_adam_touch(pags_adam *adam, pags_gaussians *g, int64_t cluster, int64_t step);
/* Step `step` with gradients (`planes` planes, plane p at data + p * stride; where the Gaussians have Fourier terms,
 * theirs follow), then the cluster's bounds, widened so that they hold until its next update. Thread-safe as touch. A
 * row with a parameter that isn't finite (3e38 or more), or a gradient that isn't or is 1e18 or more, stays as it is,
 * moments included, whatever its other planes hold. Returns how many rows that were; `first` (may be NULL) receives the
 * first of them, its first such plane and why, if there was one. */
int pags_adam_update(pags_adam *adam, pags_gaussians *g, pags_clusters *clusters, int64_t cluster,
                     const float *gradient, int64_t stride, int planes, pags_nonfinite_row *first);
/* Bounds of a cluster as of its last update; of all, after regroup. */
void pags_adam_bound(const pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, int64_t cluster);
void pags_adam_bound_all(pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, pags_tasks *tasks);

/* Pays everything: parameters and moments of all clusters current as of `step`. Changes what the moments round to, so
 * it belongs to steps that the schedule fixes (densify, reset), not to moments that a user chooses. */
void pags_adam_settle(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks);
/* Parameters only: brings all of `g` up to `step` and changes no bit of the run. */
void pags_adam_flush(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks);

/* Zero moments of planes [first, last). */
void pags_adam_forget(pags_adam *adam, int first, int last);

#endif
