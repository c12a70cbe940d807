/* SPDX-License-Identifier: Apache-2.0 */
/* The Adam optimiser (Kingma and Ba 2015) over the Gaussians of a model, with deferred updates: a step costs time in
 * proportion to the clusters in view, yet gives the same parameters as Adam over all Gaussians at every step.
 *
 * A cluster that no view shows gets no gradient, but its moments still move its parameters at every step. Those steps
 * are left pending. `pags_adam_touch` applies the pending steps before the cluster's Gaussians are read;
 * `pags_adam_update` applies them and then does a step with gradients. Each pending step is rounded by itself, from
 * moments that only a gradient changes, so applying the steps early, late or in pieces gives the same bits, and so
 * does touching a cluster in view none of whose Gaussians is drawn. */
#ifndef PAGS_TRAIN_ADAM_H
#define PAGS_TRAIN_ADAM_H

#include <stdbool.h>

#include <pags/frame.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "train/nonfinite.h"
#include "train/schedule.h"

struct pags_kernels;

/* Planes of Gaussians or of their moments, the Fourier terms last. */
static inline int pags_all_planes(const pags_gaussians *g) {
  return pags_plane_count(g->sh_degree) + pags_fourier_planes(g);
}
static inline float *pags_any_plane(const pags_gaussians *g, int plane) {
  const int standard = pags_plane_count(g->sh_degree);
  return plane < standard ? pags_plane(g, plane) : g->fourier + (int64_t)(plane - standard) * g->stride;
}

/* The number of planes, of which the first `planes` of an SH degree and the Fourier terms of their coefficients have
 * gradients: those terms follow the `planes` in arrays of gradients, and come first in g->fourier. */
static inline int pags_gradient_planes(const pags_gaussians *g, int planes) {
  const int all = pags_fourier_planes(g), active = PAGS_FOURIER_PLANES / 3 * (planes - PAGS_SH);
  return planes + (active < all ? active : all);
}

/* Rows of a cluster: `size`, but for the last of `count` rows. */
static inline int pags_cluster_rows(int64_t count, int size, int64_t cluster) {
  const int64_t left = count - cluster * size;
  return left < size ? (int)left : size;
}

typedef struct pags_adam {
  const pags_schedule *schedule;
  const struct pags_kernels *kernels;
  pags_gaussians first, second; /* Adam's moments, one row per Gaussian, laid out as the parameters */
  int cluster_size;
  int64_t cluster_count, cluster_capacity;
  int32_t *moment_step; /* per cluster: the step of its last gradient */
  int32_t *param_step;  /* per cluster: the last step applied to its parameters, >= moment_step */
  int64_t table_steps;  /* entries of `correction`, `fall` and `position_rate`, which are indexed by step k */
  double *correction;   /* c_k = sqrt(1 - beta2^k) / (1 - beta1^k); the other two lie in the same block */
  double *fall;         /* pags_schedule_fall */
  double *position_rate;
  int reach;     /* number of steps after a gradient until its momentum is negligible: q^reach < 1e-9 */
  double *decay; /* q^j, j = 0 .. reach, q = beta1 / sqrt(beta2) */
  int64_t step;  /* the step that pags_adam_begin was called with */
  double reach_position, reach_unit; /* sums over j >= 1 of rate c_(step+j) q^j: the positions' rate, and rate 1 */
} pags_adam;

/* Creates the optimiser of the parameters `g`, with zero moments and no pending steps as of `step`. `last_step` is
 * the largest step that the run will do. Must be destroyed on failure, too. */
pags_result pags_adam_create(pags_adam *adam, const pags_schedule *schedule, const pags_gaussians *g, int64_t step,
                             int64_t last_step);
void pags_adam_destroy(pags_adam *adam);
/* Makes room for `capacity` rows, as pags_gaussians_reserve does. */
pags_result pags_adam_reserve(pags_adam *adam, int64_t capacity);
/* Call after rows were added, removed or moved (and their moments with them): sets the number of rows to `count` and
 * marks every cluster as current as of `step`. */
pags_result pags_adam_regroup(pags_adam *adam, int64_t count, int64_t step);
/* Rebuilds the tables by step after the schedule changed. No cluster may have pending steps (pags_adam_settle). */
pags_result pags_adam_retime(pags_adam *adam, int64_t last_step);

/* Call once before the updates of a step: computes the sums that all updates of the step share. */
void pags_adam_begin(pags_adam *adam, int64_t step);
/* Applies the pending steps of a cluster up to `step` - 1. Different clusters may be touched from several threads at
 * once. */
void pags_adam_touch(pags_adam *adam, pags_gaussians *g, int64_t cluster, int64_t step);
/* Applies the cluster's pending steps, does the step given to pags_adam_begin with gradients (`planes` planes, plane
 * p at gradient + p * stride; the gradients of pags_gradient_planes' Fourier terms follow), then sets the
 * cluster's bounds, widened so that they hold until its next update. Thread-safe in the same way as touch. A row
 * keeps all its parameters and moments if any of its parameters isn't finite (3e38 or more) or any of its gradients
 * isn't finite or is 1e18 or more. Returns the number of such rows; `first` (may be NULL) receives the first of them,
 * its first such plane and the reason. */
int pags_adam_update(pags_adam *adam, pags_gaussians *g, pags_clusters *clusters, int64_t cluster,
                     const float *gradient, int64_t stride, int planes, pags_nonfinite_row *first);
/* Sets the bounds of one cluster as of its last update; pags_adam_bound_all sets those of all clusters, as needed
 * after regroup. */
void pags_adam_bound(const pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, int64_t cluster);
void pags_adam_bound_all(pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, pags_tasks *tasks);

/* Applies all pending steps: the parameters and moments of all clusters become current as of `step`. This changes how
 * the moments are rounded, so call it only at steps that the schedule fixes (densify, reset), never at moments that a
 * user chooses. */
void pags_adam_settle(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks);
/* Applies all pending steps to the parameters alone, so that all of `g` is current as of `step`; changes no bit of
 * the run's results. */
void pags_adam_flush(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks);

/* Sets the moments of planes [first, last) to zero. */
void pags_adam_forget(pags_adam *adam, int first, int last);

/* The same optimiser for a parameter of six numbers: a pose (rotation, translation) or an exposure (three gains, three
 * offsets). */
typedef struct pags_adam6 {
  double first[6], second[6];
  int64_t count; /* number of gradients to date, for the bias correction of the moments */
} pags_adam6;

/* Updates the moments with a gradient. `step` receives Adam's direction m / (sqrt v + 1e-15), bias-corrected; the
 * caller subtracts it times a learning rate. Returns false, with the moments and `step` unchanged, if a number of
 * the gradient isn't finite (|g| >= 1e150 counts as not finite): then the parameter must not move. */
bool pags_adam6_step(pags_adam6 *moments, const double gradient[6], const pags_train_config *config, double step[6]);

#endif
