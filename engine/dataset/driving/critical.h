/* SPDX-License-Identifier: Apache-2.0 */
/* Which classes, boxes and masks of a driving set are critical: vehicles, pedestrians and cyclists, or what was asked
 * for. */
#ifndef PAGS_DATASET_DRIVING_CRITICAL_H
#define PAGS_DATASET_DRIVING_CRITICAL_H

#include "dataset/driving/driving_set.h"

/* Fills in driving->critical and the views' part_path. `list` NULL: vehicles, pedestrians and cyclists. After rules,
 * views and tracks. */
pags_result pags_critical_choose(pags_driving *driving, const char *list, pags_parsed_dataset *parsed);

/* Adds the notes that say which masks there are and what sky and critical pixels come from. After the sweeps. */
pags_result pags_critical_note(pags_driving *driving, const pags_parsed_dataset *parsed);

/* Whether label images of this set know the sky. */
bool pags_labels_know_sky(const pags_driving *driving);

#endif
