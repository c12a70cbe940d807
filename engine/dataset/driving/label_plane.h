/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the label plane of a photograph, and the part of its mask that labels determine. */
#ifndef PAGS_DATASET_DRIVING_LABEL_PLANE_H
#define PAGS_DATASET_DRIVING_LABEL_PLANE_H

#include <pags/image.h>

#include "dataset/driving/driving_set.h"
#include "dataset/internal.h"

/* The directions in which a camera with a lens sees at its pixels, to draw labels that a pinhole's polygons can't
 * (pixel_rays.c). Zeroed: those of a pinhole, for which none are needed. */
typedef struct pags_pixel_rays {
  int width, height;
  float *direction; /* x, y, z in the camera's frame per pixel, of unit length; 0, 0, 0: nothing is seen */
} pags_pixel_rays;

/* Finds the directions at the pixels' centres; none of a pinhole. */
pags_result pags_pixel_rays_create(const pags_camera *camera, pags_pixel_rays *out);
void pags_pixel_rays_destroy(pags_pixel_rays *rays);

/* Adds `bits` in `plane` (`stride` bytes a row) at the pixels whose rays meet a box of this pose and size. */
void pags_pixel_rays_fill_box(const pags_pixel_rays *rays, const pags_camera *camera,
                              const double world_from_object[12], const double size[3], int stride, uint8_t bits,
                              uint8_t *plane);

/* Whether photographs of this view have a label plane: it has label files, or its set has boxes or LiDAR. */
bool pags_label_planes_exist(const pags_dataset *dataset, int64_t view);

/* Loads the label files of a view at the resolution of the source picture. `labels` (one channel, bits PAGS_LABEL_*)
 * is created if the view has any label file. `mask` (one channel, 255 = use) is cleared at the pixels to exclude and
 * created first if it does not exist. */
pags_result pags_label_plane_load(const pags_dataset *dataset, int64_t view, pags_image *labels, pags_image *mask);

/* Adds the labels of boxes and, if nothing else labels the sky, the sky from LiDAR to the label plane of the finished
 * photograph, whose camera is `camera`. */
pags_result pags_label_plane_add(const pags_dataset *dataset, int64_t view, const pags_camera *camera, int stride,
                                 uint8_t *plane);

/* Sets PAGS_LABEL_SKY at pixels whose viewing direction lies above the horizon and above the highest LiDAR returns of
 * its azimuth (sky_from_lidar.c). `rays`: those of the camera. */
pags_result pags_sky_from_lidar(const pags_driving *driving, int frame, const pags_camera *camera,
                                const pags_pixel_rays *rays, int stride, uint8_t *plane);

#endif
