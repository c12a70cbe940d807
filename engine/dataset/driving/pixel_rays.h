/* SPDX-License-Identifier: Apache-2.0 */
/* The directions in which a camera with a lens sees at its pixels, to draw labels that a pinhole's polygons can't. */
#ifndef PAGS_DATASET_DRIVING_PIXEL_RAYS_H
#define PAGS_DATASET_DRIVING_PIXEL_RAYS_H

#include <pags/camera.h>

/* Zeroed: those of a pinhole, for which none are needed. */
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

#endif
