/* SPDX-License-Identifier: Apache-2.0 */
/* Draws dots, lines, numbers and projected 3D boxes onto pictures (U8, 3 channels), for pags info. */
#ifndef PAGS_CLI_OVERLAY_DRAW_H
#define PAGS_CLI_OVERLAY_DRAW_H

#include <pags/camera.h>
#include <pags/dataset.h>
#include <pags/image.h>
#include <stdbool.h>

/* Creates a picture of a photograph's colours. */
pags_result pags_photo_image(const pags_photo *photo, pags_image *out);

/* Draws a filled square with a side of 2 * half + 1 px, centred on pixel (x, y) and clipped to the picture. `image`
 * is U8 with 3 channels. */
void pags_draw_dot(pags_image *image, double x, double y, int half, const uint8_t rgb[3]);

/* Draws a line two pixels wide from pixel a to pixel b, clipped to the picture. */
void pags_draw_line(pags_image *image, const double a[2], const double b[2], const uint8_t rgb[3]);

/* Writes a number of at most 20 digits in black on white, its top left corner at pixel (x, y), 14 pixels high. */
void pags_draw_number(pags_image *image, int x, int y, int64_t number);

/* Draws the twelve edges of a box at its pose, clipped to what is at least 0.1 m in front of the camera. The front
 * face (+x) is marked by its two diagonals. `size`: edge lengths in metres. */
void pags_draw_box(pags_image *image, const pags_camera *camera, const double world_from_object[12],
                   const double size[3], const uint8_t rgb[3]);

/* Colour of a depth on a logarithmic scale: red (2 m and less) over green to blue (100 m and more). */
void pags_depth_colour(double metres, uint8_t rgb[3]);

/* Whether the view is the first of its time step; views are sorted by it. */
bool pags_view_begins_step(const pags_dataset *dataset, int64_t view);

#endif
