/* SPDX-License-Identifier: Apache-2.0 */
/* What a run will take, before it is run. */
#ifndef PAGS_TRAIN_ESTIMATE_H
#define PAGS_TRAIN_ESTIMATE_H

#include "train/run.h"

/* What a run takes: s = step_seconds * steps + scoring_seconds. */
typedef struct pags_estimate {
  double step_seconds;    /* mean over the schedule */
  double scoring_seconds; /* of the passes for scores, as many as the schedule prunes and one at its end */
  uint64_t bytes;
} pags_estimate;

/* From a few passes at each level that change no bit of the run. Makes no assumption about the machine; about growth it
 * assumes what estimate.c says. */
pags_result pags_trainer_estimate(pags_trainer *trainer, pags_estimate *out);

#endif
