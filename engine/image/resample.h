/* SPDX-License-Identifier: Apache-2.0 */
/* Shrinking by area average, of bytes. */
#ifndef PAGS_IMAGE_RESAMPLE_H
#define PAGS_IMAGE_RESAMPLE_H

#include <pags/image.h>

/* Fills `to` (U8, as many channels as `from`, already created) so that its pixel (x, y) is the mean of `from` over
 * [x * step_x, (x + 1) * step_x) x [y * step_y, (y + 1) * step_y), pixels cut by the border of that rectangle counting
 * by their covered area. Steps >= 1; what of a rectangle lies outside of `from` doesn't count. Values are averaged as
 * they are stored (display-referred), like the half-size photographs of common data sets. */
pags_result pags_shrink_mean(const pags_image *from, double step_x, double step_y, pags_image *to);

/* The same for masks, one channel: 255 where every source pixel touched is >= 128, else 0. */
void pags_shrink_mask(const pags_image *from, double step_x, double step_y, pags_image *to);

#endif
