/* SPDX-License-Identifier: Apache-2.0 */
/* Estimates the time and memory of a training run before it is run. */
#ifndef PAGS_TRAIN_ESTIMATE_H
#define PAGS_TRAIN_ESTIMATE_H

#include "train/run.h"

/* Time and memory of a run. Seconds: step_seconds * steps + scoring_seconds. */
typedef struct pags_estimate {
  double step_seconds;    /* mean over the steps of the run */
  double scoring_seconds; /* of all score passes: one per prune, one at the end */
  uint64_t bytes;
} pags_estimate;

/* Measures a few passes at each resolution level, which change no bit of the run, and extrapolates. Assumes nothing
 * about the machine; the assumptions about growth are listed in estimate.c. */
pags_result pags_trainer_estimate(pags_trainer *trainer, pags_estimate *out);

#endif
