/* SPDX-License-Identifier: Apache-2.0 */
/* The files of a data set's photographs: where they are, what they are called, and whether they fit their cameras. */
#ifndef PAGS_DATASET_PICTURES_H
#define PAGS_DATASET_PICTURES_H

#include <math.h>
#include <stdbool.h>

#include "dataset/parsed.h"

/* Whether pictures of two sizes can show the same: equal sizes, or the same ratio of sides but for rounding. */
typedef enum pags_size_fit { PAGS_FIT_NONE, PAGS_FIT_SCALED, PAGS_FIT_EXACT } pags_size_fit;

/* PAGS_FIT_SCALED: there is a scale by which each side of the larger picture differs from the smaller one's by less
 * than a pixel of that one. */
static inline pags_size_fit pags_size_fits(int width, int height, int other_width, int other_height) {
  if (width == other_width && height == other_height)
    return PAGS_FIT_EXACT;
  const bool smaller = (double)width * height < (double)other_width * other_height;
  const double w = smaller ? width : other_width, h = smaller ? height : other_height;
  const double larger_w = smaller ? other_width : width, larger_h = smaller ? other_height : height;
  return fabs(w / larger_w - h / larger_h) <= 1 / larger_w + 1 / larger_h ? PAGS_FIT_SCALED : PAGS_FIT_NONE;
}

/* The part of a path below the folder `root`; the whole path where it lies elsewhere. */
const char *pags_path_below(const char *root, const char *path);

/* Points the views of a static set to the pictures in `image_folder`; NULL: to those in input, images_2, images_4 or
 * images_8 if all are missing where the set says. `root`: the data set's folder. */
pags_result pags_pictures_relocate(const char *root, const char *image_folder, pags_parsed_dataset *parsed);

/* Names the views and sorts those of a static set by name. Fails if two are of one file. */
pags_result pags_pictures_name(pags_parsed_dataset *parsed);

/* Reads the headers of all pictures that were not read yet. In a static set, scales the intrinsics of cameras of
 * another size and chooses by which EXIF orientation pictures are turned; fails if a picture doesn't fit its camera.
 * Logs what was guessed. `asked`: an image folder was asked for, so that another size is no surprise. */
pags_result pags_pictures_check(pags_parsed_dataset *parsed, bool asked, pags_image_alpha alpha);

#endif
