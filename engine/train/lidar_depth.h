/* SPDX-License-Identifier: Apache-2.0 */
/* LiDAR as sparse depth of the training views. */
#ifndef PAGS_TRAIN_LIDAR_DEPTH_H
#define PAGS_TRAIN_LIDAR_DEPTH_H

#include <pags/dataset.h>

typedef struct pags_lidar_depth_sample {
  float x, y;  /* px at full size of the view's camera (divide by the shrink) */
  float depth; /* camera z, metres */
} pags_lidar_depth_sample;

/* Points of the view's own time step that its camera sees: projected, those hidden behind nearer ones (a z-buffer of
 * coarse cells, since the LiDAR sits elsewhere) left out, at most `most`, chosen evenly. Empty where there is no sweep.
 * Also for held-out views: evaluation asks for them, training must not. `samples` is freed by the caller. */
pags_result pags_lidar_depth_samples(const pags_dataset *dataset, int64_t view, int64_t most, int64_t *count,
                                     pags_lidar_depth_sample **samples);

#endif
