/* SPDX-License-Identifier: Apache-2.0 */
/* What LiDAR of a recording measured, where the data set of a scene is at hand. */
#ifndef PAGS_PROXY_LIDAR_H
#define PAGS_PROXY_LIDAR_H

#include <pags/scene.h>

#include "exporters/proxy/lidar_fit.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_lidar {
  int64_t count;
  float *points; /* outside of labelled boxes: 3 each, metres, relative to the scene's origin */
  int64_t object_count;
  pags_lidar_fit *objects; /* in the box of each of the scene's objects; NULL: there is no LiDAR */
} pags_lidar;

/* The points of the sweeps of time steps that are trained on, or with `held_out` of those that aren't. None where there
 * is no data set, or no LiDAR, or where it can't be read (a line in the log). */
pags_result pags_lidar_read(const pags_scene *scene, int held_out, pags_lidar *out);
void pags_lidar_destroy(pags_lidar *lidar); /* frees and zeroes */

#ifdef __cplusplus
}
#endif
#endif
