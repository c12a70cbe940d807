/* SPDX-License-Identifier: Apache-2.0 */
/* Resampling of a distorted photograph, and of its mask, to the pinhole of pags_lens_pinhole. */
#ifndef PAGS_DATASET_UNDISTORT_H
#define PAGS_DATASET_UNDISTORT_H

#include <pags/image.h>

#include "dataset/lens.h"

/* `from`: U8, RGB, of the lens's size. `from_mask`: U8, one channel, the same size, or NULL. `to` and `to_mask` are
 * created here. A pixel of to_mask is 255 where the pixel has a source and every source pixel that it is mixed from is
 * >= 128 in from_mask. `to_mask` stays empty (data NULL) when there is no from_mask and every pixel has a source.
 * Pixels without a source are black. */
pags_result pags_undistort(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                           const pags_image *from_mask, pags_image *to, pags_image *to_mask);

/* The same for labels, one channel, by nearest neighbour; 0 where there is no source. */
pags_result pags_undistort_labels(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                                  pags_image *to);

#endif
