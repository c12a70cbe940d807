/* SPDX-License-Identifier: Apache-2.0 */
/* Decides which classes of label images, boxes and dynamic masks of a driving set are critical: vehicles, pedestrians
 * and cyclists by default, else what options.critical lists. */
#ifndef PAGS_DATASET_DRIVING_CRITICAL_H
#define PAGS_DATASET_DRIVING_CRITICAL_H

#include "dataset/driving/driving_set.h"

/* Fills in driving->critical and part_path of the views. `list` NULL: vehicles, pedestrians and cyclists. Call it
 * after the rules, the views and the tracks have been read. */
pags_result pags_critical_choose(pags_driving *driving, const char *list, pags_parsed_dataset *parsed);

/* Adds the notes that state which masks exist and what the sky and critical pixels are taken from. Call it after the
 * sweeps have been found. */
pags_result pags_critical_note(pags_driving *driving, const pags_parsed_dataset *parsed);

/* Whether the label images' classes include the sky. */
bool pags_labels_know_sky(const pags_driving *driving);

#endif
