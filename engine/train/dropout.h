/* SPDX-License-Identifier: Apache-2.0 */
/* Adaptive stochastic dropout (DropGaussian, Park et al. 2025, with a semantic factor): for each photograph a
 * Gaussian is left out with probability
 *
 *     D = (1 - beta S_sem) gamma t / t_total
 *
 * and the opacity of the remaining Gaussians is multiplied by 1 / (1 - D). A pixel's colour is linear in each
 * Gaussian's alpha and drops are independent, so the mean over draws is the full picture, but for three
 * nonlinearities: the cap on alpha, which the rasteriser applies to the multiplied opacity, the cut at 1/255 and the
 * early stop (docs/lab/dropout.md has the size of that bias).
 *
 * The random numbers depend on (seed, photograph, model, row) alone. Edits of the rows are functions of the run, so a
 * row is the same Gaussian in any run that does these steps, however many threads it has and wherever it was
 * interrupted. */
#ifndef PAGS_TRAIN_DROPOUT_H
#define PAGS_TRAIN_DROPOUT_H

#include "train/schedule.h"

typedef struct pags_dropout {
  uint64_t seed;
  int64_t photograph,
      object;  /* photograph: its number in the run; object: the model's object number, -1 for the background */
  double most; /* gamma t / t_total: the D of a Gaussian with S_sem 0 */
  double beta;
  int64_t first_row; /* the model's number of the row that is row 0 of the arrays; a multiple of 16 */
} pags_dropout;

/* Returns the dropout of a photograph, by its number in the run, for one model; its `most` is 0 if the configuration
 * has no dropout. t_total is the schedule's length in photographs; those beyond it count as its last. */
pags_dropout pags_dropout_at(const pags_schedule *schedule, int64_t photograph, int64_t object);

/* Fills factor[first .. first + count - 1] with factors of opacity: 0 for a dropped Gaussian, 1 / (1 - D) for the
 * rest. first and count are multiples of 4. `s_sem` and `factor` point to row 0; s_sem NULL means 0 for all. */
void pags_dropout_draw(const pags_dropout *dropout, const float *s_sem, int64_t first, int64_t count, float *factor);

/* Returns the largest factor that a draw can give, which is that of S_sem 0. */
float pags_dropout_boost(const pags_dropout *dropout);

#endif
