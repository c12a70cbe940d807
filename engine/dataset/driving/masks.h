/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the mask pictures of a view of a driving set. */
#ifndef PAGS_DATASET_DRIVING_MASKS_H
#define PAGS_DATASET_DRIVING_MASKS_H

#include "dataset/driving/driving_set.h"

/* Sets *out to the path of the view's FOLDER/TTT_C.png, or to NULL if there is no such file. The caller frees it. */
pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out);

#endif
