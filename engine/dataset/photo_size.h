/* SPDX-License-Identifier: Apache-2.0 */
/* Whether pictures of two sizes can show the same: equal sizes, or the same ratio of sides but for rounding. */
#ifndef PAGS_DATASET_PHOTO_SIZE_H
#define PAGS_DATASET_PHOTO_SIZE_H

#include <math.h>
#include <stdbool.h>

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

#endif
