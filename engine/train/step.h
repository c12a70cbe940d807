/* SPDX-License-Identifier: Apache-2.0 */
/* One training step: for each of its views, compose the parts, render, evaluate the losses, backward pass; then the
 * parameter updates that wait for all views. */
#ifndef PAGS_TRAIN_STEP_H
#define PAGS_TRAIN_STEP_H

#include "train/run.h"

/* Draws a round of `count` views, at most one for each rank: view v->view at level v->level, as photograph v->number of
 * the run in step `step`; evaluates the losses and goes backward. Fills the rest of each `v`; adds the times of its
 * phases to trainer->ms. Collective. */
pags_result pags_train_round(pags_trainer *trainer, int64_t step, pags_step_view *views, int count);

/* Ends the step after its last view: updates what waits for all of them. */
pags_result pags_train_finish(pags_trainer *trainer, int64_t step);

#endif
