/* SPDX-License-Identifier: Apache-2.0 */
/* Planes: flat pieces of the background's surface as the LiDAR measured them, and drawing Gaussians onto them.
 *
 * The picture and the expected depth leave open where along a ray its Gaussians lie, as long as they blend to the same:
 * they come to fill a surface's neighbourhood, below the road above all. Where many sweeps agree on a plane, that is
 * known better. */
#ifndef PAGS_INIT_LIDAR_PLANES_H
#define PAGS_INIT_LIDAR_PLANES_H

#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "init/lidar_points.h"

typedef struct pags_lidar_plane {
  uint64_t key;    /* of its cell and level */
  float centre[3]; /* mean of its points, metres, relative to the data set's origin */
  float normal[3]; /* of length 1; 0: there are points, but they don't lie in a plane */
} pags_lidar_plane;

typedef struct pags_lidar_planes {
  int64_t count;
  pags_lidar_plane *list;
  uint64_t mask;  /* slots - 1 */
  int32_t *table; /* open addressing: indices of the list, -1: free */
} pags_lidar_planes;

/* From the sweeps of training time steps; empty where there are none. The same for any number of threads. */
pags_result pags_lidar_planes_create(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_planes *out);
/* From the background's among such points but those of parked things, whose panels and windows are no planes; those
 * that share a cell of 0.4, 0.8 or 1.6 m and fit a plane become a plane. */
pags_result pags_lidar_planes_fit(const pags_lidar_points *points, pags_lidar_planes *out);
void pags_lidar_planes_destroy(pags_lidar_planes *self); /* a zeroed struct is allowed */

/* Moves means that lie within 0.3 m of a plane, in front or behind, towards its plane by `share` (0..1) of what their
 * distance exceeds 3 cm by, but not those of parked things. Bounds of clusters no longer fit. Returns 0 when cancelled.
 */
int pags_lidar_planes_pull(const pags_lidar_planes *self, pags_gaussians *g, double share, pags_tasks *tasks);

#endif
