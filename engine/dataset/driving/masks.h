/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and loads the mask pictures and label images of a driving set, and decides which classes of label images, boxes
 * and dynamic masks are critical (critical.c). */
#ifndef PAGS_DATASET_DRIVING_MASKS_H
#define PAGS_DATASET_DRIVING_MASKS_H

#include <pags/image.h>

#include "dataset/driving/driving_set.h"

/* Sets *out to the path of the view's FOLDER/TTT_C.png, or to NULL if there is no such file. The caller frees it. */
pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out);

/* Loads a mask: U8, one channel, of the photograph's size. PAGS_ERROR_FORMAT for another size. The caller destroys
 * *out, also on failure. */
pags_result pags_driving_load_mask(const char *path, const pags_lens *lens, pags_image *out);

/* The same for a look at a mask: at least its first `rows` rows (pags_image_load_top). */
pags_result pags_driving_load_mask_top(const char *path, const pags_lens *lens, int rows, pags_image *out);

/* Loads a label image in the same way; the samples are ids of classes. Fails with PAGS_ERROR_FORMAT if the picture has
 * colours in place of ids, or ids above 255. */
pags_result pags_driving_load_labels(const char *path, const pags_lens *lens, pags_image *out);

/* Whether a label image is a PNG with colours or a palette, by its header. */
bool pags_driving_has_colours(const char *path);

/* Returns the least value that is white in a mask: 128, or 1 if the mask holds nothing but 0 and 1. */
uint8_t pags_driving_white(const pags_image *mask);

/* Fills in driving->critical and part_path of the views. `list`: options.critical; NULL: vehicles, pedestrians and
 * cyclists. Call it after the rules, the views and the tracks have been read. */
pags_result pags_critical_choose(pags_driving *driving, const char *list, pags_parsed_dataset *parsed);

/* Adds the notes that state which masks exist and what the sky and critical pixels are taken from. Call it after the
 * sweeps have been found. */
pags_result pags_critical_note(pags_driving *driving, const pags_parsed_dataset *parsed);

/* Whether the label images' classes include the sky. */
bool pags_labels_know_sky(const pags_driving *driving);

#endif
