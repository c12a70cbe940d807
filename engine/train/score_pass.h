/* SPDX-License-Identifier: Apache-2.0 */
/* Scores of how much each Gaussian matters, measured by one pass over the training views.
 *
 * S_sem is the share of a Gaussian's visible weight (alpha T, summed over pixels and views) that lies on critical
 * pixels: a wall behind a car gets no credit for the car's mask. A Gaussian that no view shows keeps the value it had
 * or inherited. S_grad's raw value is the score of Speedy-Splat (Hanson et al. 2025).
 *
 * The paper's S_sem (OVERLAP) is measured once, before the first step: the mean over views of the share of the
 * Gaussian's alpha on critical pixels, hidden or not. Its S_grad is summed by the steps of training themselves. */
#ifndef PAGS_TRAIN_SCORE_PASS_H
#define PAGS_TRAIN_SCORE_PASS_H

#include <stdbool.h>

#include "train/run.h"

/* Which pictures a pass looks at: every training view at the size of the last step done; at half that size (but not
 * below training's smallest size) and, from 100 views on, half of the views, which ranks Gaussians nearly as well in a
 * sixth of the time; every view at its full size, with S_sem as the paper has it. */
typedef enum pags_score_pass_kind {
  PAGS_SCORE_PASS_WHOLE,
  PAGS_SCORE_PASS_ROUGH,
  PAGS_SCORE_PASS_PAPER
} pags_score_pass_kind;

typedef struct pags_score_pass {
  int64_t count;                     /* number of rows of all models, model after model */
  double *seen, *critical, *squared; /* sums over the training views (see pags_cluster_score); `seen` and `critical`
                                        only over views with labels, `drawn` (the same sum as `seen`) over all. With
                                        kind PAPER `seen` counts views and `critical` adds up their shares */
  double *drawn;
} pags_score_pass;

/* Collective: measures the scores at the SH degree of the last step done. The run must be settled (no pending Adam
 * steps); nothing of it is changed. The same bits for any number of threads. The scores must be destroyed on failure,
 * too. */
pags_result pags_score_pass_measure(pags_trainer *trainer, pags_score_pass_kind kind, pags_score_pass *out);
void pags_score_pass_destroy(pags_score_pass *scores); /* a zeroed struct is allowed */

/* Returns whether the data set has any labels of critical classes. */
bool pags_score_pass_has_labels(const pags_dataset *dataset);

/* Sets S_sem of all rows that were seen. Does nothing if the data set has no labels. */
void pags_score_pass_write_s_sem(pags_train_state *state, const pags_score_pass *scores);
/* Collective: measures and sets S_sem of all Gaussians before the first step, by a pass of the kind PAPER. Does nothing
 * unless the data set has labels and the configuration asks for it. */
pags_result pags_score_pass_set_s_sem(pags_trainer *trainer);

#endif
