/* SPDX-License-Identifier: Apache-2.0 */
/* Cameras that stand far from all others of a capture, as those of pictures whose registration failed do, and the
 * origin of a data set. */
#ifndef PAGS_DATASET_FAR_CAMERAS_H
#define PAGS_DATASET_FAR_CAMERAS_H

#include <stdbool.h>

#include <pags/dataset.h>

/* Finds the far cameras of a static set, with a warning, then sets the origin: with large coordinates (metres in a map
 * grid) the mean position of the other cameras rounded to whole metres, so that positions relative to it fit single
 * precision; else zero. Call it after the views are made and before the points are. */
pags_result pags_dataset_set_origin(pags_dataset *dataset);

/* Whether the camera of a view is a far one, which says nothing of the size and the middle of the scene. */
bool pags_dataset_is_far(const pags_dataset *dataset, int64_t view);

#endif
