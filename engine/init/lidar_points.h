/* SPDX-License-Identifier: Apache-2.0 */
/* Points on their way to becoming first Gaussians of a driving scene: gathered from sweeps, thinned, coloured. */
#ifndef PAGS_INIT_LIDAR_POINTS_H
#define PAGS_INIT_LIDAR_POINTS_H

#include <pags/dataset.h>
#include <pags/tasks.h>

enum {
  PAGS_CANDIDATE_MEASURED,
  PAGS_CANDIDATE_MIRRORED, /* of a vehicle's measured point, on the other side */
  PAGS_CANDIDATE_GRID      /* in a box, whether anything is there or not */
};

typedef struct pags_lidar_point {
  float p[3];     /* metres: background: relative to the data set's origin; else in the owner's frame */
  float time;     /* seconds since the first sweep */
  int32_t owner;  /* moving object that it moves with; -1: background */
  int32_t parked; /* background: object that doesn't move in whose box it lies, -1: none */
  int32_t source; /* mirrored: the point it is the mirror image of, else -1 */
  int32_t kind;   /* PAGS_CANDIDATE_* */
  float merged;   /* how many measured points it is the mean of */
  float sum[4];   /* of weighted colours (0..255) and of their weights */
  float views[2]; /* views that show the point; of these, views with a critical pixel there */
} pags_lidar_point;

typedef struct pags_lidar_points {
  int64_t count, room;
  pags_lidar_point *rows;
} pags_lidar_points;

pags_result pags_lidar_points_reserve(pags_lidar_points *self, int64_t room);
void pags_lidar_points_destroy(pags_lidar_points *self); /* a zeroed struct is allowed */

/* Reads the sweeps of training time steps and shares their points out among the boxes as they stand at that time: all
 * of those in moving objects' boxes (enlarged by 0.1 m, less the ground they stand on), of the rest an even choice of
 * at most `most`. */
pags_result pags_lidar_points_gather(const pags_dataset *dataset, pags_tasks *tasks, int64_t most,
                                     pags_lidar_points *out);

/* For each moving object, of its measured points at most `most`, evenly; with fewer than `few`, and if it is a vehicle,
 * their mirror images; with fewer than `few`, a grid of points in its box, too. */
pags_result pags_lidar_points_complete(const pags_dataset *dataset, int64_t most, int64_t few,
                                       pags_lidar_points *points);

/* Merges points of the background that share a voxel into their mean (position, colour, time), keeping the order of
 * first appearance. A voxel's side is `side` up to 10 m from the nearest of the eyes (xyz relative to the origin),
 * twice that from 10 to 20 m, and so on: about the same number of pixels everywhere. Points of objects stay as they
 * are. */
pags_result pags_lidar_points_merge(pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                                    double side);

/* Removes points of the background that lie where the cameras have been: nothing that stands there, but the recording
 * car itself. */
pags_result pags_lidar_points_remove_rig(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                         int64_t eye_count);

/* Removes points of the background whose three nearest neighbours are more than four times as far away as is usual at
 * their distance from the eyes. */
pags_result pags_lidar_points_remove_outliers(pags_lidar_points *points, pags_tasks *tasks, const float *eyes,
                                              int64_t eye_count);

#endif
