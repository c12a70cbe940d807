/* SPDX-License-Identifier: Apache-2.0 */
/* A trial of something that a run models only where it pays: it is fitted from `pags_trial_from` on without one of
 * eight training photographs, which decide at `pags_trial_end` and are given back then (trial_end.h). */
#ifndef PAGS_TRAIN_TRIAL_H
#define PAGS_TRAIN_TRIAL_H

#include <math.h>
#include <stdbool.h>

#include "train/schedule.h"

typedef enum pags_trial_state {
  PAGS_TRIAL_NONE, /* nothing was tried */
  PAGS_TRIAL_RUNS,
  PAGS_TRIAL_PAID,
  PAGS_TRIAL_FAILED
} pags_trial_state;

typedef struct pags_trial {
  int64_t state;    /* a pags_trial_state */
  double gain;      /* what it brought on the photographs kept out, dB of PSNR; NaN before the end */
  double uncertain; /* standard error of `gain` */
} pags_trial;

static inline pags_trial pags_trial_begin(void) {
  return (pags_trial){PAGS_TRIAL_RUNS, (double)NAN, (double)NAN};
}

/* The step of the schedule after which things on trial are fitted: before it, the Gaussians have hardly begun to show
 * where things are. */
static inline int64_t pags_trial_from(const pags_schedule *schedule) {
  return (int64_t)(0.05 * (double)schedule->length);
}

/* The step after which trials are decided. */
static inline int64_t pags_trial_end(const pags_schedule *schedule) {
  return (int64_t)ceil(0.3 * (double)schedule->length);
}

/* Whether the training view `index`, by its place among the training views, is kept out. */
static inline bool pags_trial_keeps(int64_t index) {
  return index % 8 == 4;
}

#endif
