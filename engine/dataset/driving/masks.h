/* SPDX-License-Identifier: Apache-2.0 */
/* The masks that lie beside the photographs. */
#ifndef PAGS_DATASET_DRIVING_MASKS_H
#define PAGS_DATASET_DRIVING_MASKS_H

#include "dataset/driving/driving_set.h"

/* FOLDER/TTT_C.png of a view where it exists, else NULL. */
pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out);

#endif
