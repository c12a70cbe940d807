/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the report of what a run modelled and why (sky, exposure, tracks, each object), as JSON: the member
 * "modelled" of scene.json. */
#ifndef PAGS_TRAIN_MODEL_REPORT_H
#define PAGS_TRAIN_MODEL_REPORT_H

#include <pags/dataset.h>

#include "train/state.h"

/* `text` receives the JSON text; it is freed by the caller. */
pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *state, char **text);

#endif
