/* SPDX-License-Identifier: Apache-2.0 */
/* The ground as heights over a lattice of x and y: one value each, no holes near the recording car's path. World z up.
 */
#ifndef PAGS_PROXY_GROUND_H
#define PAGS_PROXY_GROUND_H

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/lidar.h"
#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_ground {
  int nx, ny;
  double x0, y0, step; /* of point 0, 0; metres */
  float *z;
  uint8_t *known; /* 0: no ground here; 1: measured; 2: filled in */
} pags_ground;

/* From what the views (in the scene's frame) see and LiDAR measured; `path` are 3 doubles a camera. nx is 0 where
 * no ground was found. */
pags_result pags_ground_find(const pags_depth_views *depth_views, const pags_lidar *lidar, const double *path,
                             int64_t path_count, double reach, pags_ground *out);
/* Ground everywhere within `reach` of the path, what is there smoothed; cells that are known count by their weights. */
pags_result pags_ground_fill(pags_ground *ground, const float *weights, const double *path, int64_t path_count,
                             double reach);
void pags_ground_destroy(pags_ground *ground);

/* Height at x, y; 0 where there is no ground. */
int pags_ground_height(const pags_ground *ground, double x, double y, double *z);

/* At most `budget` triangles, none of them turned over. */
pags_result pags_ground_mesh(const pags_ground *ground, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
