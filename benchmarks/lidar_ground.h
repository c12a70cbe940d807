/* SPDX-License-Identifier: Apache-2.0 */
/* Heights of a ground mesh against LiDAR's own ground. */
#ifndef PAGS_BENCHMARKS_LIDAR_GROUND_H
#define PAGS_BENCHMARKS_LIDAR_GROUND_H

#include <pags/scene.h>
#include "exporters/proxy/mesh_query.h"
#include "exporters/proxy/proxy_error.h"

typedef struct pags_lidar_ground {
  int64_t sweeps, points, missed; /* held-out ones; points of the ground; of these without mesh above or below */
  pags_proxy_distance error;      /* of heights, metres */
} pags_lidar_ground;

/* Of the sweeps of held-out time steps of the scene's data set, within 25 m of the cameras. `ground` is relative to the
 * scene's origin. */
pags_result pags_lidar_ground_measure(const pags_scene *scene, const pags_mesh_query *ground, pags_lidar_ground *out);

#endif
