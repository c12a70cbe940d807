/* SPDX-License-Identifier: Apache-2.0 */
/* Finds cameras that stand far from all others of a capture, as those of pictures whose registration failed do. */
#ifndef PAGS_SCENE_FAR_CAMERAS_H
#define PAGS_SCENE_FAR_CAMERAS_H

#include <stdbool.h>
#include <stdint.h>

#include <pags/base.h>

typedef struct pags_far_cameras {
  int64_t count;    /* of the far cameras; 0: `far` is false everywhere */
  double middle[3]; /* the median of the positions, axis by axis */
  double near;      /* the distance from there that three quarters of the cameras are within */
} pags_far_cameras;

/* Sets far[i] for each of `count` cameras at positions (3 numbers each) that is more than 20 times as far from the
 * median position as three quarters of the cameras and than `size`, that of the scene or 0. Where these are more than
 * an eighth of the cameras (of fewer than eight, more than one), the capture has several parts, and none is far. */
pags_result pags_far_cameras_find(const double *positions, int64_t count, double size, bool *far,
                                  pags_far_cameras *out);

#endif
