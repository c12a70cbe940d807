/* SPDX-License-Identifier: Apache-2.0 */
/* Draws dots, lines, numbers, projected 3D boxes and a map onto pictures (U8, 3 channels), for pags info. */
#ifndef PAGS_CLI_OVERLAY_DRAW_H
#define PAGS_CLI_OVERLAY_DRAW_H

#include <pags/camera.h>
#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/object.h>
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

/* ---- The map of a data set from above, a part of the sheet of pags info ---- */

/* Projection of the map: pixel x = scale * (p . across) + at[0], y = scale * (p . down) + at[1]. */
typedef struct pags_map {
  double across[3], down[3]; /* unit vectors of the world on the ground plane */
  double scale;              /* pixels per world unit */
  double at[2];
  int width, height; /* pixels */
} pags_map;

/* Fits a map of at most width x most_height pixels around the cameras of a data set with one view or more. */
pags_map pags_map_fit(const pags_dataset *dataset, int width, int most_height);

/* Draws the map onto a picture, `top` rows below its upper edge. `views`: the `count` views that are numbered, by their
 * time steps or, in a static set, by their own numbers. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (a sweep), PAGS_ERROR_MEMORY.
 */
pags_result pags_map_draw(const pags_map *map, const pags_dataset *dataset, const int64_t *views, int count,
                          pags_image *image, int top);

#endif
