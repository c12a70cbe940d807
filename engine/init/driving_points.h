/* SPDX-License-Identifier: Apache-2.0 */
/* Points to start from in a driving scene: LiDAR coloured by the photographs and shared out between background and
 * objects. */
#ifndef PAGS_INIT_DRIVING_POINTS_H
#define PAGS_INIT_DRIVING_POINTS_H

#include <pags/dataset.h>
#include <pags/tasks.h>
#include <pags/train.h>

typedef struct pags_start_points {
  int64_t count;
  float *xyz;   /* 3 a point: background: relative to the data set's origin; objects: in the object's frame, metres */
  uint8_t *rgb; /* 3 a point */
  int32_t *object; /* background only: index of the data set's object in whose box a parked thing's point lies, else -1;
                      NULL in those of objects */
  float *s_sem; /* background only: share of the views showing a point that show something critical there, 0 where none
                   is known; NULL in those of objects */
} pags_start_points;

typedef struct pags_start {
  pags_start_points background;
  int64_t object_count;
  pags_start_points *objects; /* one for each of the data set's objects; empty for those that don't move */
  int64_t lidar_points;       /* of the background: how many came from LiDAR; the rest are SfM's and far random ones */
} pags_start;

/* Uses training time steps and training views only. `lidar`: 0 leaves the LiDAR out (for measuring what it brings). The
 * same points for any number of threads. */
pags_result pags_start_create(const pags_dataset *dataset, const pags_train_config *config, int lidar,
                              pags_tasks *tasks, pags_start *out);
void pags_start_destroy(pags_start *start);

#endif
