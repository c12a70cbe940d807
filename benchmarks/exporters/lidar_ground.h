/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the heights of an exported ground mesh with the ground points of held-out LiDAR sweeps. */
#ifndef PAGS_BENCHMARKS_LIDAR_GROUND_H
#define PAGS_BENCHMARKS_LIDAR_GROUND_H

#include <pags/scene.h>
#include "exporters/proxy/mesh_query.h"
#include "exporters/proxy/proxy_error.h"

typedef struct pags_lidar_ground {
  /* held-out sweeps; their ground points; ground points without mesh above or below */
  int64_t sweeps, points, missed;
  pags_proxy_distance error; /* absolute height errors, metres */
} pags_lidar_ground;

/* Measures the held-out sweeps of the scene's data set, within 25 m of the cameras. `ground` is in coordinates
 * relative to the scene's origin. All zero and NaN if the scene names no data set. */
pags_result pags_lidar_ground_measure(const pags_scene *scene, const pags_mesh_query *ground, pags_lidar_ground *out);

#endif
