/* SPDX-License-Identifier: Apache-2.0 */
/* The table of the training configuration's fields, defined in fields.c and read by the functions of
 * <pags/train.h>. */
#ifndef PAGS_TRAIN_FIELDS_H
#define PAGS_TRAIN_FIELDS_H

#include <pags/train.h>

/* Largest number of steps of a run. Each model's optimiser allocates 16 bytes per step, so the limit also bounds the
 * memory that a damaged checkpoint can ask for. */
enum { PAGS_CONFIG_STEPS = 10000000 };

extern const pags_train_field pags_fields[];
extern const int pags_field_count;

#endif
