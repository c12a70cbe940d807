/* SPDX-License-Identifier: Apache-2.0 */
/* Turns LiDAR points into sparse depth samples of a view's pixels, for the depth loss and for evaluation. */
#ifndef PAGS_TRAIN_LIDAR_DEPTH_H
#define PAGS_TRAIN_LIDAR_DEPTH_H

#include <pags/dataset.h>

typedef struct pags_lidar_depth_sample {
  float x, y;  /* px at the full size of the view's camera (divide by the shrink factor of a smaller picture) */
  float depth; /* camera z, metres */
} pags_lidar_depth_sample;

/* Lists the LiDAR points of the view's own time step that its camera sees, at most `most` of them, chosen evenly. The
 * points are projected; those hidden behind nearer ones are left out by a z-buffer of coarse cells, since the LiDAR
 * sits elsewhere than the camera. The list is empty if the time step has no sweep. Works for held-out views, too:
 * evaluation uses them, training must not. `samples` is freed by the caller. */
pags_result pags_lidar_depth_samples(const pags_dataset *dataset, int64_t view, int64_t most, int64_t *count,
                                     pags_lidar_depth_sample **samples);

#endif
