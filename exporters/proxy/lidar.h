/* SPDX-License-Identifier: Apache-2.0 */
/* The LiDAR points of a scene's recording, read from its data set if that is still present (lidar.c), and the
 * correction of an object's TSDF by those on it (lidar_fit.c). */
#ifndef PAGS_PROXY_LIDAR_H
#define PAGS_PROXY_LIDAR_H

#include <pags/scene.h>

#include "exporters/proxy/tsdf.h"

/* The points on one object. */
typedef struct pags_lidar_fit {
  int64_t count, capacity;
  float *points; /* 3 each, metres, the object's frame */
} pags_lidar_fit;

pags_result pags_lidar_fit_add(pags_lidar_fit *cloud, const double point[3]);
void pags_lidar_fit_destroy(pags_lidar_fit *cloud); /* frees and zeroes */

/* Moves the zero surface of the grid's signed distance to the LiDAR points. Points at which the distance is `reach`
 * metres or more are ignored. The distance at each point (its residual) is spread over neighbourhoods, coarse ones
 * first, and subtracted from the grid (multilevel approximation of scattered data, Lee, Wolberg and Shin 1997). */
pags_result pags_lidar_fit_pull(const pags_lidar_fit *cloud, pags_tsdf *grid, double reach);

typedef struct pags_lidar {
  int64_t count;
  float *points; /* points outside of labelled boxes: 3 floats each, metres, relative to the scene's origin */
  int64_t object_count;
  pags_lidar_fit *objects; /* for each of the scene's objects the points in its box; NULL: there is no LiDAR */
} pags_lidar;

/* Reads the points of the sweeps of training time steps, or with `held_out` of held-out time steps. The result is
 * empty if there is no data set or no LiDAR, or if it can't be read (a log line says so). */
pags_result pags_lidar_read(const pags_scene *scene, bool held_out, pags_lidar *out);
void pags_lidar_destroy(pags_lidar *lidar); /* frees and zeroes */

#endif
