/* SPDX-License-Identifier: Apache-2.0 */
/* Shrinks U8 images and masks by area averaging. */
#ifndef PAGS_IMAGE_RESAMPLE_H
#define PAGS_IMAGE_RESAMPLE_H

#include <pags/image.h>

/* Fills `to` (U8, as many channels as `from`, already created) so that its pixel (x, y) is the mean of `from` over
 * the rectangle [x * step_x, (x + 1) * step_x) x [y * step_y, (y + 1) * step_y), in which each source pixel is
 * weighted by its covered area. Steps are >= 1. Parts of a rectangle outside of `from` do not count. Values are
 * averaged as they are stored (display-referred), like in the half-size photographs of common data sets. */
pags_result pags_shrink_mean(const pags_image *from, double step_x, double step_y, pags_image *to);

/* Shrinks a mask of one channel in the same way, except that an output pixel is 255 if every source pixel that its
 * rectangle touches is >= 128, else 0. */
void pags_shrink_mask(const pags_image *from, double step_x, double step_y, pags_image *to);

#endif
