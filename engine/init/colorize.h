/* SPDX-License-Identifier: Apache-2.0 */
/* Colours LiDAR points from the training photographs, and draws random points where the photographs show surfaces
 * without LiDAR points. */
#ifndef PAGS_INIT_COLORIZE_H
#define PAGS_INIT_COLORIZE_H

#include "init/lidar_points.h"
#include "init/z_buffer.h"

/* Random points drawn on pixels that have no LiDAR point near them. */
typedef struct pags_far_points {
  int64_t wanted; /* how many are to be drawn over all photographs */
  uint64_t seed;
  double farthest; /* largest depth, metres */
  int64_t count;   /* how many have been drawn */
  float *xyz;      /* relative to the data set's origin; freed by the user */
  uint8_t *rgb;
} pags_far_points;

/* Adds to `sum` of each point the colours of the training photographs that show it, weighted by nearness in space and
 * time. The first `measured` rows, the measured points, hide what lies behind them. An object's points are coloured
 * only at times at which the object has a pose. Also draws far->wanted random points into `far`, fewer if the
 * photographs have too few pixels for them. */
pags_result pags_lidar_points_colorize(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_points *points,
                                       int64_t measured, pags_photo_cache *photos, pags_far_points *far);

/* Draws up to `count` random points on one photograph and adds them to `far`, which has room. `z_buffer` holds the
 * LiDAR points of the photograph; `from`, the view's number, selects the random numbers. */
void pags_far_draw(const pags_photo *photo, const pags_camera *camera, const pags_z_buffer *z_buffer,
                   const double *origin, uint64_t from, int64_t count, pags_far_points *far);

#endif
