/* SPDX-License-Identifier: Apache-2.0 */
/* The label plane of a photograph, and what its mask adds to the view's own. */
#ifndef PAGS_DATASET_DRIVING_LABEL_PLANE_H
#define PAGS_DATASET_DRIVING_LABEL_PLANE_H

#include <pags/image.h>

#include "dataset/driving/driving_set.h"
#include "dataset/internal.h"

/* Whether photographs of this view have a label plane. */
bool pags_label_planes_exist(const pags_dataset *dataset, int64_t view);

/* What picture files say, in the source's pixels. `labels` (one channel, bits PAGS_LABEL_*) is created where any of
 * them exists; `mask` (one channel, 255 = use) is created where pixels are to be left out, or has them cleared. */
pags_result pags_label_plane_load(const pags_dataset *dataset, int64_t view, pags_image *labels, pags_image *mask);

/* What boxes and laser say, added to a plane of the finished photograph, whose camera is `camera`. */
pags_result pags_label_plane_add(const pags_dataset *dataset, int64_t view, const pags_camera *camera, int stride,
                                 uint8_t *plane);

/* Sets PAGS_LABEL_SKY where a direction rises above the horizon and above all that the LiDAR met there. */
pags_result pags_sky_from_lidar(const pags_driving *driving, int frame, const pags_camera *camera, int stride,
                                uint8_t *plane);

#endif
