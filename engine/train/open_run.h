/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a training run: from nothing, or from its checkpoint. */
#ifndef PAGS_TRAIN_OPEN_RUN_H
#define PAGS_TRAIN_OPEN_RUN_H

#include "train/run.h"

/* Creates the state of a fresh run (start), or loads that of a run to be continued (resume). A resumed run keeps the
 * configuration of its checkpoint, and `config` must agree with it. Before the call, the training views must have
 * been listed (pags_views_list). */
pags_result pags_trainer_start(pags_trainer *trainer, const pags_train_config *config);
pags_result pags_trainer_resume(pags_trainer *trainer, const pags_train_config *config);

#endif
