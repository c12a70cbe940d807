/* SPDX-License-Identifier: Apache-2.0 */
/* The initial points of a driving scene: LiDAR points coloured by the photographs and split between the background
 * and the moving objects, points of structure from motion, and random far points. */
#ifndef PAGS_INIT_DRIVING_POINTS_H
#define PAGS_INIT_DRIVING_POINTS_H

#include <pags/dataset.h>
#include <pags/tasks.h>
#include <pags/train.h>

typedef struct pags_point_set {
  int64_t count;
  float *xyz;      /* 3 a point, metres: background relative to the data set's origin, objects in their own frames */
  uint8_t *rgb;    /* 3 a point */
  int32_t *object; /* background only, else NULL: index of the parked object in whose box the point lies, -1: none */
  float *s_sem;    /* background only, else NULL: of the labelled views that show the point, the share in which its
                      pixel is critical; 0 without such views */
} pags_point_set;

typedef struct pags_driving_points {
  pags_point_set background;
  int64_t object_count;
  pags_point_set *objects; /* one for each object of the data set; empty for objects that do not move */
  int64_t lidar_points;    /* how many background points, the first ones, are LiDAR's; SfM and far ones follow */
} pags_driving_points;

/* Makes the initial points from training time steps and training views only. `lidar` 0 leaves the LiDAR out, to
 * measure what it brings. The points are the same for any number of threads. */
pags_result pags_driving_points_create(const pags_dataset *dataset, const pags_train_config *config, int lidar,
                                       pags_photo_cache *photos, pags_tasks *tasks, pags_driving_points *out);
void pags_driving_points_destroy(pags_driving_points *start);

#endif
