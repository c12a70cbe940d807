/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses through which camera the photographs of a view are trained: a pinhole, to which they are resampled, or the
 * lens that took them. */
#ifndef PAGS_DATASET_VIEW_CAMERA_H
#define PAGS_DATASET_VIEW_CAMERA_H

#include "dataset/internal.h"

/* Prepares the lens of view `index` and sets dataset->cameras[index]: the pinhole of pags_lens_pinhole or, unless
 * `undistort`, the lens itself where that pinhole would show less than nine tenths of what the lens sees. *share: the
 * part of the picture (0 to 1) at which the lens can't be inverted, 0 if an earlier view has the same lens. */
pags_result pags_view_camera_choose(pags_dataset *dataset, int64_t index, bool undistort, double *share);

/* Clears the pixels of `mask` (one channel, 255: used) that the lens of `camera` doesn't see, with a margin of a pixel;
 * creates it if some aren't seen and it has no data. A pinhole sees all. */
pags_result pags_view_camera_mask(const pags_camera *camera, pags_image *mask);

#endif
