/* SPDX-License-Identifier: Apache-2.0 */
/* Planes fitted to the background's LiDAR points, and pulling Gaussians onto them.
 *
 * Losses on the picture and on the expected depth do not determine where along a ray its Gaussians lie, as long as
 * they blend to the same value; during training, Gaussians come to fill a layer about a surface, above all below the
 * road. Where the points of many sweeps agree on a plane, the surface's position is known better than that. */
#ifndef PAGS_INIT_LIDAR_PLANES_H
#define PAGS_INIT_LIDAR_PLANES_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "init/lidar_points.h"

typedef struct pags_lidar_plane {
  uint64_t key;    /* packed coordinates and size of its cell */
  float centre[3]; /* mean of the cell's points, metres, relative to the data set's origin */
  float normal[3]; /* unit normal; zero for a rough cell, whose points do not lie in a plane */
} pags_lidar_plane;

typedef struct pags_lidar_planes {
  int64_t count;
  pags_lidar_plane *list;
  uint64_t mask;  /* number of the table's slots - 1 */
  int32_t *table; /* hash table with open addressing: indices into `list`, -1: free */
} pags_lidar_planes;

/* Fits planes to the sweeps of the training time steps; without sweeps `out` is empty. The result is the same for any
 * number of threads. */
pags_result pags_lidar_planes_create(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_planes *out);
/* Fits planes to the background's points in cells of 0.4, 0.8, 1.6 and 3.2 m. Points of parked objects are left out,
 * since bodywork and windows are no planes. */
pags_result pags_lidar_planes_fit(const pags_lidar_points *points, pags_lidar_planes *out);
void pags_lidar_planes_destroy(pags_lidar_planes *planes); /* a zeroed struct is allowed */

/* Moves the means of Gaussians within 0.3 m of a plane of cells up to 1.6 m, on either side, towards it by `share`
 * (0..1) of the amount by which their distance exceeds 3 cm. Gaussians of parked objects (object_id >= 0) stay. The
 * caller must renew bounds of clusters, which no longer fit. Returns 0 when cancelled. */
bool pags_lidar_planes_pull(const pags_lidar_planes *planes, pags_gaussians *g, double share, pags_tasks *tasks);

/* Lays Gaussians within 0.1 m of the ground into it, by `share` (0..1) of the way: into the plane of the largest cell
 * that has one, where its slope is less than 26 degrees (z is up). The mean comes to the plane, the one of its axes
 * that is nearest to the normal turns to the normal, and where its sigma along that axis exceeds 5 mm, the logarithm of
 * the sigma falls to that of 5 mm (flat Gaussians: 2DGS, Huang et al. 2024). A Gaussian that isn't in the surface, or
 * that reaches out of it, blends to the right colours from where the photographs were taken, and to a stroke along
 * their line of sight from elsewhere. Gaussians of parked objects (object_id >= 0) stay. The caller must renew bounds
 * of clusters. The same bits for any number of threads. Returns false when cancelled. */
bool pags_lidar_planes_lay(const pags_lidar_planes *planes, pags_gaussians *g, double share, pags_tasks *tasks);

#endif
