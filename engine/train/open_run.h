/* SPDX-License-Identifier: Apache-2.0 */
/* How a run begins. */
#ifndef PAGS_TRAIN_OPEN_RUN_H
#define PAGS_TRAIN_OPEN_RUN_H

#include "train/run.h"

/* The state of a fresh run, or of one that goes on: a resumed run has the checkpoint's configuration, and what `config`
 * asks for must agree with it. The training views must be listed. */
pags_result pags_trainer_start(pags_trainer *trainer, const pags_train_config *config);
pags_result pags_trainer_resume(pags_trainer *trainer, const pags_train_config *config);

#endif
