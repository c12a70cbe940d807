/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning by score: removes the Gaussians with the lowest S_hybrid, which combines semantic priority S_sem and
 * sensitivity S_grad, over all models together. */
#ifndef PAGS_TRAIN_PRUNE_H
#define PAGS_TRAIN_PRUNE_H

#include "train/run.h"

/* Runs prune number `index` of the schedule on a settled run (no pending Adam steps): measures scores, removes the
 * Gaussians with the lowest, sorts the rest. */
pags_result pags_prune(pags_trainer *trainer, int index);

/* Returns the number of Gaussians that prune number `index` leaves of `count`. */
int64_t pags_prune_target(const pags_schedule *schedule, int index, int64_t count);

/* Replaces raw scores >= 0 (NaN and less count as 0) by their percentile rank, 0..1, in `out`: the share of the other
 * scores that are lower; equal scores don't count as lower. The rows are those of all ranks of `transport`, in the
 * order of their numbers; NULL, NULL: this rank's alone. */
pags_result pags_prune_rank(pags_transport *transport, const uint32_t *numbers, const double *raw, int64_t count,
                            float *out);

/* Returns S_hybrid, in 0..1, of both scores, by a resolved configuration (pags_config_resolve). */
double pags_prune_hybrid(const pags_train_config *config, double s_sem, double s_grad);

typedef struct pags_prune_request {
  int64_t count;
  const float *score;
  const int32_t *group; /* per row: 0: no floor; else a number per object */
  int64_t groups;       /* group numbers are below it */
  int64_t target;       /* number of rows to keep */
  int64_t floor; /* rows that each group but 0 keeps at least; if floors took more than half of the target, they are
                    lowered to half */
  uint64_t seed, draw;       /* order rows of equal scores at random: neighbours in memory are neighbours in space */
  pags_transport *transport; /* the rows are those of several ranks; NULL: of this one */
  const uint32_t *numbers;   /* per row: its place among the rows of all ranks; NULL: its index */
} pags_prune_request;

/* Chooses the rows to remove: drop[i] becomes 1 for those, 0 for the rest; `dropped` receives the number of rows to
 * remove, which is less than the target asks for if floors forbid more. */
pags_result pags_prune_choose(const pags_prune_request *request, uint8_t *drop, int64_t *dropped);

#endif
