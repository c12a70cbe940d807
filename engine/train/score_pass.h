/* SPDX-License-Identifier: Apache-2.0 */
/* How much each Gaussian matters, measured by one pass over the training views.
 *
 * S_sem is the share of what is seen of a Gaussian (alpha T, summed over pixels and views) that shows something
 * critical: a wall behind a car gets no credit for the car's mask. What no view shows keeps the value it had or
 * inherited. S_grad's raw value is Speedy-Splat's (Hanson et al. 2025). */
#ifndef PAGS_TRAIN_SCORE_PASS_H
#define PAGS_TRAIN_SCORE_PASS_H

#include "train/run.h"

typedef struct pags_score_pass {
  int64_t count;                     /* rows of all models, model after model */
  double *seen, *critical, *squared; /* sums over the training views; see pags_cluster_score. `seen` and `critical` only
                                        where the view has labels; `drawn` everywhere */
  double *drawn;
} pags_score_pass;

/* Renders every training view at its size and SH degree of the step done; `rough`: at half that size (nothing smaller
 * than training's smallest), which ranks Gaussians nearly as well for a third of the time. The run must be settled;
 * changes nothing. The same bits for any number of threads. */
pags_result pags_score_pass_measure(pags_trainer *trainer, int rough, pags_score_pass *out);
void pags_score_pass_destroy(pags_score_pass *scores); /* a zeroed struct is allowed */

/* Does the data set say anywhere what is critical? */
int pags_score_pass_has_labels(const pags_dataset *dataset);

/* S_sem of all models' rows that were seen; nothing where the data set says nothing or S_sem is to stay as it began. */
void pags_score_pass_write_s_sem(pags_train_state *state, const pags_score_pass *scores);
/* S_sem of the scene as its schedule ends, measured once more. All rows must be current. */
pags_result pags_score_pass_finish(pags_trainer *trainer);

/* Adds to density.squared what the step's own gradient says, after the frame's backward pass. `ones`, `zeros`: planes
 * of these. */
pags_result pags_score_pass_add_training(pags_trainer *trainer, const pags_picture_gradient *gradient,
                                         const float *ones, const float *zeros);

#endif
