/* SPDX-License-Identifier: Apache-2.0 */
/* The LiDAR points of a scene's recording, read from its data set if that is still present. */
#ifndef PAGS_PROXY_LIDAR_H
#define PAGS_PROXY_LIDAR_H

#include <pags/scene.h>

#include "exporters/proxy/lidar_fit.h"

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
