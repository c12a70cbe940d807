/* SPDX-License-Identifier: Apache-2.0 */
/* A holdout test decides whether a run keeps an optional correction. The correction is optimised after
 * `pags_holdout_test_from` without every eighth training photograph, and tested on these at `pags_holdout_test_until`
 * (holdout_decision.c). After the test they are trained on, too. */
#ifndef PAGS_TRAIN_HOLDOUT_TEST_H
#define PAGS_TRAIN_HOLDOUT_TEST_H

#include <math.h>
#include <stdbool.h>

#include "train/schedule.h"

typedef enum pags_holdout_test_state {
  PAGS_HOLDOUT_NONE, /* no test */
  PAGS_HOLDOUT_RUNNING,
  PAGS_HOLDOUT_PASSED,
  PAGS_HOLDOUT_FAILED
} pags_holdout_test_state;

typedef struct pags_holdout_test {
  int64_t state;    /* a pags_holdout_test_state */
  double gain;      /* gain in PSNR on the holdout photographs, dB; NaN before the test */
  double uncertain; /* standard error of `gain` */
} pags_holdout_test;

static inline pags_holdout_test pags_holdout_test_begin(void) {
  return (pags_holdout_test){PAGS_HOLDOUT_RUNNING, (double)NAN, (double)NAN};
}

/* The step of the schedule after which corrections are optimised: before it the Gaussians hardly show where things
 * are. */
static inline int64_t pags_holdout_test_from(const pags_schedule *schedule) {
  return (int64_t)(0.05 * (double)schedule->length);
}

/* The step of the test. */
static inline int64_t pags_holdout_test_until(const pags_schedule *schedule) {
  return (int64_t)ceil(0.3 * (double)schedule->length);
}

/* The least gain, dB, with which a correction stays. The Gaussians were
 * trained with the correction, which alone brings 0.15 dB where there is nothing to correct. The corrections of a
 * capture are independent: there it is 0.33 dB with poses and 0.25 dB with exposures (docs/lab/inputs.md). */
static inline double pags_holdout_least_gain(bool capture) {
  return capture ? 0.6 : 0.3;
}

/* Whether the gain is large enough, and larger than the noise: than two standard errors, with exposures than one, since
 * photographs that are exposed as the mean gain nothing. */
static inline bool pags_holdout_pays(const pags_holdout_test *test, pags_train_decision part, bool capture) {
  const double errors = part == PAGS_DECISION_EXPOSURE ? 1.0 : 2.0;
  return test->gain >= pags_holdout_least_gain(capture) && test->gain > errors * test->uncertain;
}

/* Whether the training view `index`, by its place among the training views, is reserved for the test. */
static inline bool pags_is_holdout_view(int64_t index) {
  return index % 8 == 4;
}

#endif
