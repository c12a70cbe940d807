/* SPDX-License-Identifier: Apache-2.0 */
/* Signed distance on a regular grid, fused from depths, and the surface where it is zero. */
#ifndef PAGS_PROXY_TSDF_H
#define PAGS_PROXY_TSDF_H

#include <pags/tasks.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_GRID_BLOCK = 8 }; /* points a side of the blocks that are fused or not together */

typedef struct pags_tsdf {
  int n[3];         /* points along x, y, z */
  double origin[3]; /* of point 0, 0, 0; metres, model frame */
  double step;      /* metres */
  float *distance;  /* metres, negative inside; point (x, y, z) at (z * n[1] + y) * n[0] + x */
  float *weight;    /* how much is known of it; 0: nothing */
  uint8_t *active;  /* one a block: to be fused; NULL: all */
  int blocks[3];
} pags_tsdf;

/* PAGS_ERROR_LIMIT beyond 2^28 points. `sparse`: with blocks, none active. */
pags_result pags_tsdf_create(pags_tsdf *grid, const double lo[3], const double hi[3], double step, int sparse);
void pags_tsdf_destroy(pags_tsdf *grid);

/* Activates the blocks within `reach` of a point. */
void pags_tsdf_touch(pags_tsdf *grid, const double point[3], double reach);

/* Curless and Levoy 1996: the weighted mean of the distances along the rays, cut off at `truncation` in front and
 * unknown beyond it behind. With `carve`, rays that meet nothing say that they are free. Same bits for any number of
 * threads; false when cancelled. */
bool pags_tsdf_fuse(pags_tsdf *grid, const pags_depth_views *depth_views, double truncation, double range, int carve,
                    pags_tasks *tasks);

/* Marching tetrahedra (Kuhn's six a cell), which leaves no hole and no edge with more than two faces: closed where the
 * border of the grid is outside. With `known_only`, cells with an unknown corner give nothing. Vertices are `observed`
 * where both ends of their edge have a weight of at least 0. */
pags_result pags_tsdf_surface(const pags_tsdf *grid, int known_only, pags_proxy_mesh *out);

/* Views that may see any of a run of vertices; `seen` has room for all. */
int64_t pags_depth_views_of_run(const pags_depth_views *depth_views, const pags_proxy_mesh *mesh, int64_t begin,
                                int64_t end, int64_t *seen);

/* Colours of vertices: the mean over the views that see them, the nearer the more. Others take the mean of those. */
bool pags_proxy_mesh_paint(pags_proxy_mesh *surface, const pags_depth_views *depth_views, double tolerance,
                           pags_tasks *tasks);

#ifdef __cplusplus
}
#endif
#endif
