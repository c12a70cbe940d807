/* SPDX-License-Identifier: Apache-2.0 */
/* The ground as a height field over a lattice in x and y, without holes near the path of the ego vehicle. For worlds
 * with z up. */
#ifndef PAGS_PROXY_GROUND_H
#define PAGS_PROXY_GROUND_H

#include <stdbool.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/lidar.h"
#include "exporters/proxy/mesh.h"

/* While the ground is sought: cells to be filled if they are joined to the ground; those of a hole. */
enum { PAGS_GROUND_WANTED = 3, PAGS_GROUND_HOLE };

typedef struct pags_ground {
  int nx, ny;
  double x0, y0, step; /* position of lattice point (0, 0), distance of lattice points; metres */
  float *z;            /* height of each lattice point, metres */
  uint8_t *known;      /* 0: no ground here; 1: measured; 2: filled in; others while it is sought */
  float *nearest;      /* height of the nearest lattice point with ground, metres */
} pags_ground;

/* Finds the ground from LiDAR points and depth views in the scene's frame. `path`: positions of the cameras, 3
 * doubles each; within `reach` metres of it holes are filled, and beyond `margin` metres from it there is no ground.
 * `out->nx` is 0 if no ground was found. After a failure, too, the caller destroys `out`. */
pags_result pags_ground_find(const pags_depth_views *depth_views, const pags_lidar *lidar, const double *path,
                             int64_t path_count, double reach, double margin, pags_ground *out);
/* Marks the cells without ground that views show as ground as wanted, by the labels of their pixels (ground_seen.c).
 * `queue` has room for all cells. */
pags_result pags_ground_see(const pags_depth_views *depth_views, int64_t *queue, pags_ground *ground);
/* Sets `nearest` at all lattice points to the height of the nearest one with ground, by a breadth-first search. */
void pags_ground_spread(const pags_ground *ground, float *nearest, int64_t *queue);
/* Fills the wanted cells, the holes within `reach` metres of the path and small ones anywhere, and smooths the ground;
 * measured cells keep to their heights by their weights. Sets `nearest`. */
pags_result pags_ground_fill(pags_ground *ground, const float *weights, const double *path, int64_t path_count,
                             double reach);
void pags_ground_destroy(pags_ground *ground);

/* The cell of a point in x and y; -1 outside of the lattice. */
int64_t pags_ground_cell(const pags_ground *ground, double x, double y);

/* Interpolates the height at x, y into `z`. Returns false if there is no ground. */
bool pags_ground_height(const pags_ground *ground, double x, double y, double *z);

/* The height at the lattice point with ground that is nearest to x, y. Returns false if there is no ground at all. */
bool pags_ground_nearest(const pags_ground *ground, double x, double y, double *z);

/* Makes a mesh of at most `budget` triangles, of which none is turned over as seen from above. */
pags_result pags_ground_mesh(const pags_ground *ground, int64_t budget, pags_proxy_mesh *out);

#endif
