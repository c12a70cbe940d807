/* SPDX-License-Identifier: Apache-2.0 */
/* LiDAR points from which the initial Gaussians of a driving scene are made: gathered from the sweeps, thinned,
 * completed by mirror images and grids, and coloured. */
#ifndef PAGS_INIT_LIDAR_POINTS_H
#define PAGS_INIT_LIDAR_POINTS_H

#include <pags/dataset.h>
#include <pags/tasks.h>

enum {
  PAGS_CANDIDATE_MEASURED,
  PAGS_CANDIDATE_MIRRORED, /* mirror image of a vehicle's measured point on its other side */
  PAGS_CANDIDATE_GRID      /* point of a regular grid in an object's box, which need not lie on a surface */
};

typedef struct pags_lidar_point {
  float p[3];     /* metres: in the frame of its owner; the background's relative to the data set's origin */
  float time;     /* of its measurement, seconds since the first sweep; NaN for points of a grid */
  int32_t owner;  /* the moving object that it belongs to; -1: the background */
  int32_t parked; /* for points of the background: the parked object in whose box it lies; -1: none */
  int32_t source; /* for mirrored points: the row of the point that it mirrors, else -1 */
  int32_t kind;   /* PAGS_CANDIDATE_* */
  float merged;   /* number of measured points that it is the mean of */
  float sum[4];   /* weighted sum of colours (0..255), and sum of the weights */
  float views[2]; /* number of labelled views that show the point; of those in which its pixel is critical */
} pags_lidar_point;

typedef struct pags_lidar_points {
  int64_t count, room;
  pags_lidar_point *rows;
} pags_lidar_points;

pags_result pags_lidar_points_reserve(pags_lidar_points *points, int64_t room);
void pags_lidar_points_destroy(pags_lidar_points *points); /* a zeroed struct is allowed */

/* Reads the sweeps of the training time steps and assigns their points to the objects' boxes, posed at that time.
 * Takes all points in boxes of moving objects (enlarged by 0.1 m, without the ground below), and of all others an
 * even choice of at most `most`. */
pags_result pags_lidar_points_gather(const pags_dataset *dataset, pags_tasks *tasks, int64_t most,
                                     pags_lidar_points *out);

/* Thins the measured points of each moving object to an even choice of at most `most`. An object with fewer than
 * `few` gets a grid of points in its box, and, if it is a vehicle, also the mirror images of its measured points. */
pags_result pags_lidar_points_complete(const pags_dataset *dataset, int64_t most, int64_t few,
                                       pags_lidar_points *points);

/* Merges the background's points of each voxel into their mean (position, colour, time), in the order of first
 * appearance. A voxel's side is `side` up to 10 m from the nearest eye (camera position, xyz relative to the origin),
 * twice that from 10 to 20 m, four times from 20 to 40 m and so on, so that voxels cover about the same number of
 * pixels everywhere. Points of objects stay as they are. */
pags_result pags_lidar_points_merge(pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                                    double side);

/* Removes points of the background that lie close to a camera position: they are no part of the scene, but of the ego
 * vehicle itself. */
pags_result pags_lidar_points_remove_rig(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                         int64_t eye_count);

/* Removes outliers of the background: points whose root mean square distance to the three nearest neighbours is more
 * than four times the median of points at a similar distance from the eyes. */
pags_result pags_lidar_points_remove_outliers(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                              int64_t eye_count);

#endif
