/* SPDX-License-Identifier: Apache-2.0 */
/* Decides what of a run's trials stays. */
#ifndef PAGS_TRAIN_TRIAL_END_H
#define PAGS_TRAIN_TRIAL_END_H

#include "train/run.h"

/* Whether a step leaves out the training photographs that are kept for the decision. */
bool pags_trials_keep_at(const pags_train_state *state, int64_t step);

/* After the step of the decision: draws photographs that were kept out with and without what is on trial, the poses of
 * the cameras first, then their light. What brings 0.3 dB and more than twice the standard error stays; else it is as
 * if it had never been tried. Does nothing at other steps. Errors of photographs. */
pags_result pags_trials_end(pags_trainer *trainer);

#endif
