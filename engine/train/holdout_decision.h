/* SPDX-License-Identifier: Apache-2.0 */
/* Evaluates the holdout tests of a run. */
#ifndef PAGS_TRAIN_HOLDOUT_DECISION_H
#define PAGS_TRAIN_HOLDOUT_DECISION_H

#include "train/run.h"

/* Returns whether a step skips the training photographs reserved for the tests. */
bool pags_holdout_tests_active(const pags_train_state *state, int64_t step);

/* At the step of the test: renders holdout photographs with and without the corrections, first of the camera poses,
 * then of vignetting and response curves. A correction stays if it brings 0.3 dB and more than twice the standard
 * error; otherwise it is discarded. Does nothing at other steps. Errors of reading photographs. */
pags_result pags_holdout_tests_decide(pags_trainer *trainer);

#endif
