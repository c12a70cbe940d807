/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing onto pictures: lines, dots and boxes as a camera sees them. */
#ifndef PAGS_CLI_OVERLAY_DRAW_H
#define PAGS_CLI_OVERLAY_DRAW_H

#include <pags/camera.h>
#include <pags/image.h>
#include <pags/object.h>

/* A square of 2 * half + 1 px about (x, y); what lies outside of the picture is left out. `image`: U8, 3 channels. */
void pags_draw_dot(pags_image *image, double x, double y, int half, const uint8_t rgb[3]);

/* The twelve edges of a box where it stands, the part nearer than 0.1 m cut off; the face in front (+x) has its
 * diagonals, too. */
void pags_draw_box(pags_image *image, const pags_camera *camera, const double world_from_object[12],
                   const double size[3], const uint8_t rgb[3]);

/* From red (2 m) over green to blue (100 m and more). */
void pags_depth_colour(double metres, uint8_t rgb[3]);

#endif
