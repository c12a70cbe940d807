/* SPDX-License-Identifier: Apache-2.0 */
/* The map of a data set from above, a part of the sheet of pags info (info.h). */
#ifndef PAGS_CLI_SHEET_MAP_H
#define PAGS_CLI_SHEET_MAP_H

#include <pags/dataset.h>
#include <pags/image.h>
#include <stdbool.h>

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
