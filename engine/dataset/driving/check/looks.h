/* SPDX-License-Identifier: Apache-2.0 */
/* What is looked at in the photographs of an opened driving set, with options.look: each look decodes few of them, and
 * warns with one line a kind of fault. */
#ifndef PAGS_DATASET_DRIVING_CHECK_LOOKS_H
#define PAGS_DATASET_DRIVING_CHECK_LOOKS_H

#include "dataset/internal.h"

/* Loads a photograph in grey, shrunk by area to about `width` pixels across; *step: pixels of the photograph a pixel.
 * The caller destroys *grey, also on failure. */
pags_result pags_small_photo_load(const pags_dataset *dataset, int64_t view, int width, pags_image *grey, double *step);

/* Distance in metres between the cameras of two views, and the angle in degrees between their axes. */
double pags_view_distance(const pags_dataset *dataset, int64_t a, int64_t b);
double pags_view_angle(const pags_dataset *dataset, int64_t a, int64_t b);

/* Warns of cameras of which most photographs are held out. */
void pags_held_out_check(const pags_dataset *dataset);

/* Warns of photographs without content and of those that a moving camera repeats (photographs.c). */
pags_result pags_look_at_photographs(const pags_dataset *dataset);

/* Warns if the photographs fit the poses of their cameras mirrored (mirrored.c). */
pags_result pags_look_for_mirror(const pags_dataset *dataset);

#endif
