/* SPDX-License-Identifier: Apache-2.0 */
/* Photographs of an opened driving set in grey and small, to look at what they show, and where they were taken. */
#ifndef PAGS_DATASET_DRIVING_SMALL_PHOTO_H
#define PAGS_DATASET_DRIVING_SMALL_PHOTO_H

#include "dataset/internal.h"

/* Loads a photograph in grey, shrunk by area to about `width` pixels across; *step: pixels of the photograph a pixel.
 * The caller destroys *grey. */
pags_result pags_small_photo_load(const pags_dataset *dataset, int64_t view, int width, pags_image *grey, double *step);

/* Distance in metres between the cameras of two views, and the angle in degrees between their axes. */
double pags_view_distance(const pags_dataset *dataset, int64_t a, int64_t b);
double pags_view_angle(const pags_dataset *dataset, int64_t a, int64_t b);

#endif
