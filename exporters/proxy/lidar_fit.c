/* SPDX-License-Identifier: Apache-2.0 */
/* Pulls the signed distance of an object to the LiDAR points on the object by multilevel approximation of scattered
 * data (Lee, Wolberg and Shin 1997). LiDAR points are sparse, but accurate in depth, where distant views are not. */
#include "exporters/proxy/lidar.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"

/* Radii of the neighbourhoods in metres, coarse to fine. Half of the mean residual of a neighbourhood is subtracted
 * when its points have a total weight of doubt / radius^2. Finer neighbourhoods thus need more points; else noise (5
 * to 10 cm on cars that move during a LiDAR sweep) would be modelled. */
static const double radii[] = {0.4, 0.2, 0.1};
static const double doubt = 0.16;

void pags_lidar_fit_destroy(pags_lidar_fit *cloud) {
  free(cloud->points);
  *cloud = (pags_lidar_fit){0};
}

pags_result pags_lidar_fit_add(pags_lidar_fit *cloud, const double point[3]) {
  PAGS_CHECK_MEMORY(pags_grow(&cloud->points, cloud->count + 1, &cloud->capacity, 3 * sizeof *cloud->points),
                    "%lld points", (long long)cloud->count + 1);
  pags_narrow3(point, cloud->points + 3 * cloud->count++);
  return PAGS_OK;
}

/* Samples the grid's signed distance at a point by trilinear interpolation. Returns false if the point is outside of
 * the grid. */
static bool sample(const pags_tsdf *g, const float p[3], double *out) {
  int64_t row = g->n[0], layer = row * g->n[1], at = 0, stride[3] = {1, row, layer};
  double part[3];
  for (int k = 0; k < 3; k++) {
    double u = ((double)p[k] - g->origin[k]) / g->step, low = floor(u);
    if (!(low >= 0 && low + 1 < g->n[k]))
      return false;
    part[k] = u - low;
    at += (int64_t)low * stride[k];
  }
  *out = 0;
  for (int c = 0; c < 8; c++) {
    int64_t i = at + (c & 1) + (c >> 1 & 1) * row + (c >> 2) * layer;
    *out += (double)g->distance[i] * (c & 1 ? part[0] : 1 - part[0]) * (c & 2 ? part[1] : 1 - part[1]) *
            (c & 4 ? part[2] : 1 - part[2]);
  }
  return true;
}

/* Adds a residual to `sum` and its weight to `weight` at all grid points within `radius` of a point p. The weight at
 * distance d from p is
 *     (1 - d^2 / radius^2)^2. */
static void spread(const pags_tsdf *g, const float p[3], double radius, double residual, float *sum, float *weight) {
  int from[3], to[3];
  for (int k = 0; k < 3; k++) {
    from[k] = (int)fmax(0, ceil(((double)p[k] - radius - g->origin[k]) / g->step));
    to[k] = (int)fmin(g->n[k] - 1, floor(((double)p[k] + radius - g->origin[k]) / g->step));
  }
  for (int z = from[2]; z <= to[2]; z++)
    for (int y = from[1]; y <= to[1]; y++)
      for (int x = from[0]; x <= to[0]; x++) {
        double dx = g->origin[0] + x * g->step - (double)p[0], dy = g->origin[1] + y * g->step - (double)p[1],
               dz = g->origin[2] + z * g->step - (double)p[2],
               w = 1 - (dx * dx + dy * dy + dz * dz) / (radius * radius);
        if (w <= 0)
          continue;
        int64_t at = ((int64_t)z * g->n[1] + y) * g->n[0] + x;
        sum[at] += (float)(w * w * residual);
        weight[at] += (float)(w * w);
      }
}

pags_result pags_lidar_fit_pull(const pags_lidar_fit *cloud, pags_tsdf *grid, double reach) {
  size_t count = (size_t)grid->n[0] * (size_t)grid->n[1] * (size_t)grid->n[2];
  if (!cloud->count)
    return PAGS_OK;
  PAGS_AUTOFREE float *sum = malloc(2 * count * sizeof *sum);
  PAGS_CHECK_MEMORY(sum, "a grid");
  float *weight = sum + count;
  for (size_t level = 0; level < sizeof radii / sizeof *radii; level++) {
    double residual, r = radii[level];
    memset(sum, 0, 2 * count * sizeof *sum);
    for (int64_t i = 0; i < cloud->count; i++)
      if (sample(grid, cloud->points + 3 * i, &residual) && fabs(residual) < reach)
        spread(grid, cloud->points + 3 * i, r, residual, sum, weight);
    for (size_t i = 0; i < count; i++)
      if (weight[i] > 0)
        grid->distance[i] -= sum[i] / (weight[i] + (float)(doubt / (r * r)));
  }
  return PAGS_OK;
}
