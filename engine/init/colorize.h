/* SPDX-License-Identifier: Apache-2.0 */
/* Colours for points, from the training photographs; and points where there are none. */
#ifndef PAGS_INIT_COLORIZE_H
#define PAGS_INIT_COLORIZE_H

#include "init/lidar_points.h"
#include "init/z_buffer.h"

/* Points drawn on pixels that no point is near to. */
typedef struct pags_far_points {
  int64_t wanted; /* in all */
  uint64_t seed;
  double farthest; /* metres */
  int64_t count;
  float *xyz; /* relative to the data set's origin; freed by the user */
  uint8_t *rgb;
} pags_far_points;

/* Adds to the points' sums the colours of the training photographs that see them, weighted by nearness in space and
 * time; the first `measured` rows hide what is behind them. Photographs of objects' points are those of steps at which
 * the object is there. Draws far->wanted points, fewer where the photographs have no place for them. */
pags_result pags_lidar_points_colorize(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_points *points,
                                       int64_t measured, pags_far_points *far);

/* Draws on one photograph. `photo` and `camera` are the picture's, `from` the view's number; adds to `far`, which has
 * room. */
void pags_far_draw(const pags_photo *photo, const pags_camera *camera, const pags_z_buffer *z_buffer,
                   const double *origin, uint64_t from, int64_t count, pags_far_points *far);

#endif
