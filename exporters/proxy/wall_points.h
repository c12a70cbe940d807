/* SPDX-License-Identifier: Apache-2.0 */
/* Points on walls with normals, of LiDAR and of the fused surface, in which planes are found. */
#ifndef PAGS_PROXY_WALL_POINTS_H
#define PAGS_PROXY_WALL_POINTS_H

#include "exporters/proxy/background.h"
#include "exporters/proxy/planes.h"

/* Gathers the LiDAR points that views show to be of buildings and walls, and the vertices of a fused surface, each
 * thinned to about one point in a cube of `step` metres. After a failure, too, the caller destroys `out`. */
pags_result pags_wall_points_of_lidar(const pags_proxy_maker *w, const pags_background *b, const pags_ground *ground,
                                      double step, pags_surface_points *out);
pags_result pags_wall_points_of_surface(const pags_proxy_mesh *surface, double step, pags_surface_points *out);
void pags_surface_points_destroy(pags_surface_points *points); /* frees and zeroes */

#endif
