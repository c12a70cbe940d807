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

/* Returns the bytes of the gradients that a step of several photographs adds up (gradient_store.h), with their room for
 * growth: those of Gaussians, and those of a sky of `sky_size` texels a side; 0 with one photograph a step. */
uint64_t pags_batch_bytes(const pags_train_config *config, int64_t gaussians, int sky_size);

#endif
