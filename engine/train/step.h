/* SPDX-License-Identifier: Apache-2.0 */
/* One view's way through the frame and back: compose -> render -> losses -> backward -> updates. */
#ifndef PAGS_TRAIN_STEP_H
#define PAGS_TRAIN_STEP_H

#include "train/run.h"

/* Renders, compares and goes back, with the SH degree of `step`; times are added to trainer->ms. */
pags_result pags_train_step(pags_trainer *trainer, int64_t step, pags_step_view *v);

#endif
