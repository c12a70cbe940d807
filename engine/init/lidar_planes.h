/* Facets: flat pieces of the background's surface as the laser measured them, and drawing Gaussians onto them.
 *
 * The picture and the expected depth leave open where along a ray its Gaussians lie, as long as they blend to the same:
 * they come to fill a surface's neighbourhood, below the road above all. Where many sweeps agree on a plane, that is
 * known better. */
#ifndef PAGS_INIT_LIDAR_PLANES_H
#define PAGS_INIT_LIDAR_PLANES_H

#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "init/lidar_points.h"

typedef struct pags_facet {
  uint64_t key;    /* of its cell and level */
  float centre[3]; /* mean of its points, metres, relative to the data set's origin */
  float normal[3]; /* of length 1; 0: there are points, but they don't lie in a plane */
} pags_facet;

typedef struct pags_facets {
  int64_t count;
  pags_facet *list;
  uint64_t mask;  /* slots - 1 */
  int32_t *table; /* open addressing: indices of the list, -1: free */
} pags_facets;

/* From the sweeps of training time steps; empty where there are none. The same for any number of threads. */
pags_result pags_facets_create(const pags_dataset *dataset, pags_tasks *tasks, pags_facets *out);
/* From the background's among such points but those of parked things, whose panels and windows are no planes; those
 * that share a cell of 0.4, 0.8 or 1.6 m and fit a plane become a facet. */
pags_result pags_facets_fit(const pags_candidates *points, pags_facets *out);
void pags_facets_destroy(pags_facets *self); /* a zeroed struct is allowed */

/* Moves means that lie within 0.3 m of a facet, in front or behind, towards its plane by `share` (0..1) of what their
 * distance exceeds 3 cm by, but not those of parked things. Bounds of clusters no longer fit. Returns 0 when cancelled.
 */
int pags_facets_draw(const pags_facets *self, pags_gaussians *g, double share, pags_tasks *tasks);

#endif
