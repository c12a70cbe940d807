/* SPDX-License-Identifier: Apache-2.0 */
/* Adaptive stochastic dropout: in each training step a Gaussian is left out with probability
 *
 *   D = (1 - beta S_sem) gamma t / t_total
 *
 * and the survivors' opacity is multiplied by 1 / (1 - D) (DropGaussian, Park et al. 2025, with a semantic factor). A
 * pixel's colour is linear in each alpha by itself and drops are independent, so the mean over draws is the full
 * picture; what breaks this is the cap on alpha, which the rasteriser applies to the boosted product, the cut at 1/255
 * and the early stop (docs/lab/dropout.md has the size of that bias).
 *
 * A draw belongs to (seed, step, model, row). Edits of the rows are functions of the run, so a row is the same Gaussian
 * in any run that does these steps, however many threads it has and wherever it was interrupted. */
#ifndef PAGS_TRAIN_DROPOUT_H
#define PAGS_TRAIN_DROPOUT_H

#include "train/schedule.h"

typedef struct pags_dropout {
  uint64_t seed;
  int64_t step, object; /* whose rows: the model's object, -1 for the background */
  double most;          /* gamma t / t_total: D of S_sem 0 */
  double beta;
} pags_dropout;

/* most = 0 where the configuration has no dropout. t_total is the schedule's length; steps beyond it are at its end. */
pags_dropout pags_dropout_at(const pags_schedule *schedule, int64_t step, int64_t object);

/* Factors of opacity for rows [first, first + count), first and count multiples of 4: 0 for who is dropped. `s_sem` and
 * `factor` are of row 0; s_sem may be NULL: 0. */
void pags_dropout_draw(const pags_dropout *dropout, const float *s_sem, int64_t first, int64_t count, float *factor);

/* The largest factor that a draw gives. */
float pags_dropout_boost(const pags_dropout *dropout);

#endif
