/* SPDX-License-Identifier: Apache-2.0 */
/* Points that a LiDAR measured on an object. */
#ifndef PAGS_PROXY_LIDAR_FIT_H
#define PAGS_PROXY_LIDAR_FIT_H

#include "exporters/proxy/tsdf.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_lidar_fit {
  int64_t count, capacity;
  float *points; /* 3 each, metres, the object's frame */
} pags_lidar_fit;

pags_result pags_lidar_fit_add(pags_lidar_fit *cloud, const double point[3]);
void pags_lidar_fit_destroy(pags_lidar_fit *cloud); /* frees and zeroes */

/* Draws the surface where the grid is zero to the points, passing over those farther than `reach` metres from it: what
 * the grid says at them is spread over coarse, then finer neighbourhoods and taken off (multilevel approximation of
 * scattered data, Lee, Wolberg and Shin 1997). */
pags_result pags_lidar_fit_pull(const pags_lidar_fit *cloud, pags_tsdf *grid, double reach);

#ifdef __cplusplus
}
#endif
#endif
