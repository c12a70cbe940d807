/* SPDX-License-Identifier: Apache-2.0 */
/* The table of the training's fields: <pags/train.h> reads it. */
#ifndef PAGS_TRAIN_FIELDS_H
#define PAGS_TRAIN_FIELDS_H

#include <pags/train.h>

/* Most steps of a run: each model's optimiser keeps 16 bytes for each, also where a damaged checkpoint promises them.
 */
enum { PAGS_CONFIG_STEPS = 10000000 };

extern const pags_train_field pags_fields[];
extern const int pags_field_count;

#endif
