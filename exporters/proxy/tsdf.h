/* SPDX-License-Identifier: Apache-2.0 */
/* A truncated signed distance field (TSDF) on a regular grid, fused from depth views, and its zero surface as a
 * mesh. */
#ifndef PAGS_PROXY_TSDF_H
#define PAGS_PROXY_TSDF_H

#include <pags/tasks.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

enum { PAGS_GRID_BLOCK = 8 }; /* grid points along a side of a block; a block is fused as a whole or skipped */

typedef struct pags_tsdf {
  int n[3];         /* grid points along x, y, z */
  double origin[3]; /* position of grid point (0, 0, 0); metres, model frame */
  double step;      /* distance of neighbouring grid points, metres */
  float *distance;  /* metres, negative inside; grid point (x, y, z) is at (z * n[1] + y) * n[0] + x */
  float *weight;    /* sum of the weights of the views that saw the point; 0: unknown */
  uint8_t *active;  /* for each block 1: it is fused; 0: it is skipped. NULL: all are fused */
  int blocks[3];    /* blocks along x, y, z */
} pags_tsdf;

/* Makes a grid over the box `lo`..`hi`. `sparse`: only blocks activated by pags_tsdf_touch are fused, none at first.
 * PAGS_ERROR_LIMIT for more than 2^28 points. After a failure, too, the caller destroys the grid. */
pags_result pags_tsdf_create(pags_tsdf *grid, const double lo[3], const double hi[3], double step, bool sparse);
void pags_tsdf_destroy(pags_tsdf *grid);

/* Activates the blocks that a cube of half side `reach` metres about a point touches. */
void pags_tsdf_touch(pags_tsdf *grid, const double point[3], double reach);

/* Fuses depth views (Curless and Levoy 1996). A grid point gets the weighted mean, over the views, of the distance
 * along camera z to the depth at its pixel. Distances are cut off at `truncation` in front of the surface; a view
 * says nothing of points farther than `behind` behind it, or farther than `range` from the camera. With `carve`, rays
 * that are free also count, as `truncation` in front. The bits are the same for any number of threads. PAGS_CANCELLED;
 * PAGS_ERROR_MEMORY. */
pags_result pags_tsdf_fuse(pags_tsdf *grid, const pags_depth_views *depth_views, double truncation, double behind,
                           double range, bool carve, pags_tasks *tasks);

/* Sets the distances at the grid's border, which must be outside for a closed surface. */
void pags_tsdf_close_border(pags_tsdf *grid, float distance);

/* Extracts the zero surface by marching tetrahedra (Kuhn's six for each cell), which leaves no holes and no edges of
 * more than two faces: the mesh is closed if the grid's border is outside. With `known_only`, cells with an unknown
 * corner are skipped. A vertex is `observed` if both ends of its grid edge have a weight above 0. */
pags_result pags_tsdf_surface(const pags_tsdf *grid, bool known_only, pags_proxy_mesh *out);

/* Room for a list of views for each worker of `tasks`, count + 1 numbers each; free() it. PAGS_ERROR_MEMORY. */
pags_result pags_depth_views_lists(const pags_depth_views *depth_views, const pags_tasks *tasks, int64_t **out);

/* Lists in `seen` (with room for all) the views that may see any of the mesh's vertices `begin`..`end` - 1; returns
 * how many. */
int64_t pags_depth_views_of_run(const pags_depth_views *depth_views, const pags_proxy_mesh *mesh, int64_t begin,
                                int64_t end, int64_t *seen);

/* Sets the colour of each vertex to the mean over the views that see it (whose depth agrees to within `tolerance`
 * metres), weighted by 1 / z^2; of unseen ones to -1. `density` (or NULL) receives the most pixels per metre that a
 * view has at each vertex that it sees, else 0. PAGS_CANCELLED; PAGS_ERROR_MEMORY. */
pags_result pags_proxy_mesh_paint_seen(pags_proxy_mesh *surface, const pags_depth_views *depth_views, double tolerance,
                                       float *density, pags_tasks *tasks);
/* The same, but unseen vertices get the mean colour of the seen ones. */
pags_result pags_proxy_mesh_paint(pags_proxy_mesh *surface, const pags_depth_views *depth_views, double tolerance,
                                  pags_tasks *tasks);

#endif
