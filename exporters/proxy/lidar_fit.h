/* SPDX-License-Identifier: Apache-2.0 */
/* The LiDAR points on one object, and the correction of its TSDF by them. */
#ifndef PAGS_PROXY_LIDAR_FIT_H
#define PAGS_PROXY_LIDAR_FIT_H

#include "exporters/proxy/tsdf.h"

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

#endif
