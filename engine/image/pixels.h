/* SPDX-License-Identifier: Apache-2.0 */
/* Conversion of sample types and channels, by the rules of pags_image_load, and shrinking by area averaging. */
#ifndef PAGS_IMAGE_PIXELS_H
#define PAGS_IMAGE_PIXELS_H

#include <stddef.h>

#include <pags/image.h>

static inline size_t pags_pixel_bytes(const pags_image *image) {
  return (size_t)image->channels * (image->sample == PAGS_U8 ? 1 : image->sample == PAGS_U16 ? 2 : 4);
}

/* Replaces `to`, which is freed, by `from`, which is zeroed. */
void pags_image_move(pags_image *from, pags_image *to);

/* Creates `to`, a copy of `from` with that sample type and that number of channels. PAGS_ERROR_MEMORY; then `to` is
 * zeroed. */
pags_result pags_image_converted(const pags_image *from, pags_sample sample, int channels, pags_image *to);

/* Converts `image` in place, unless it has the sample type and the channels already. PAGS_ERROR_MEMORY; then `image`
 * is as it was. */
pags_result pags_image_convert(pags_image *image, pags_sample sample, int channels);

/* Shrinks a picture: fills `to` (U8, as many channels as `from`, already created) so that its pixel (x, y) is the mean
 * of `from` over the rectangle [x * step_x, (x + 1) * step_x) x [y * step_y, (y + 1) * step_y), in which each source
 * pixel is weighted by its covered area. Steps are >= 1. Parts of a rectangle outside of `from` do not count. Values
 * are averaged as they are stored (display-referred), like in the half-size photographs of common data sets. */
pags_result pags_shrink_mean(const pags_image *from, double step_x, double step_y, pags_image *to);

/* Shrinks a mask of one channel in the same way, except that an output pixel is 255 if every source pixel that its
 * rectangle touches is >= 128, else 0. */
void pags_shrink_mask(const pags_image *from, double step_x, double step_y, pags_image *to);

#endif
