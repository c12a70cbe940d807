/* SPDX-License-Identifier: Apache-2.0 */
/* What a run modelled and why, as JSON: the scene's "modelled". */
#ifndef PAGS_TRAIN_MODEL_REPORT_H
#define PAGS_TRAIN_MODEL_REPORT_H

#include <pags/dataset.h>

#include "train/state.h"

/* `text` is freed by the caller. */
pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *state, char **text);

#endif
