/* SPDX-License-Identifier: Apache-2.0 */
/* Resamples a distorted photograph, its mask and its labels to the pinhole camera of pags_lens_pinhole. */
#ifndef PAGS_DATASET_UNDISTORT_H
#define PAGS_DATASET_UNDISTORT_H

#include <pags/image.h>

#include "scene/lens.h"

/* Undistorts a photograph. `from`: 8-bit RGB, of the lens's size. `from_mask`: 8-bit, one channel, the same size, or
 * NULL. `to` and `to_mask` are created here. A pixel of to_mask is 255 if the pixel has a source and every source
 * pixel with a nonzero weight is >= 128 in from_mask, else 0. to_mask stays empty (data NULL) if there is no
 * from_mask and every pixel has a source. Pixels without a source are black. */
pags_result pags_undistort(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                           const pags_image *from_mask, pags_image *to, pags_image *to_mask);

/* Undistorts a one-channel label image by nearest neighbour; a pixel without a source gets 0. */
pags_result pags_undistort_labels(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                                  pags_image *to);

#endif
