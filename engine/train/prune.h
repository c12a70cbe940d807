/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning by priority: the Gaussians with the lowest S_hybrid go, over all models together. */
#ifndef PAGS_TRAIN_PRUNE_H
#define PAGS_TRAIN_PRUNE_H

#include "train/run.h"

/* Prune number `index` of the schedule, of a settled run: takes scores, removes, sorts. */
pags_result pags_prune(pags_trainer *trainer, int index);

/* How many Gaussians the prune leaves of `count`. */
int64_t pags_prune_target(const pags_schedule *schedule, int index, int64_t count);

/* Raw scores >= 0 brought to 0..1 in `out`.
 * RANK: the share of others that are lower (ties: none of them is). MINMAX: linear. LOG: log(1 + x / m), m the median
 * of those over 0, then linear. */
pags_result pags_prune_normalise(pags_s_grad kind, const double *raw, int64_t count, float *out);

/* S_hybrid of both scores, in 0..1; of a resolved configuration. */
double pags_prune_hybrid(const pags_train_config *config, double s_sem, double s_grad);

typedef struct pags_prune_request {
  int64_t count;
  const float *score;
  const int32_t *group; /* 0: no floor; else one object's */
  int64_t groups;       /* groups are below it */
  int64_t target;       /* rows to keep */
  int64_t floor; /* of each group but 0; where floors would take more than half of the target they are lowered to it */
  uint64_t seed, draw; /* order rows of equal scores by chance: neighbours in memory are neighbours in space */
} pags_prune_request;

/* drop[i] = 1 for rows to remove, 0 for others; returns through *dropped how many. Fewer than asked for where floors
 * forbid. */
pags_result pags_prune_choose(const pags_prune_request *request, uint8_t *drop, int64_t *dropped);

#endif
