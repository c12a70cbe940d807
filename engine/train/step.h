/* SPDX-License-Identifier: Apache-2.0 */
/* One training step on one view: compose the parts, render, evaluate the losses, backward pass, parameter updates. */
#ifndef PAGS_TRAIN_STEP_H
#define PAGS_TRAIN_STEP_H

#include "train/run.h"

/* Does step `step` on view v->view at level v->level, with the SH degree of the step. Fills the rest of `v`; adds the
 * times of its phases to trainer->ms. */
pags_result pags_train_step(pags_trainer *trainer, int64_t step, pags_step_view *v);

#endif
