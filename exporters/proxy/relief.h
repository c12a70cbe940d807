/* SPDX-License-Identifier: Apache-2.0 */
/* The relief of a surface over a plane: a lattice of square cells in the plane, each with the distances of the solid's
 * front and back from the plane. */
#ifndef PAGS_PROXY_RELIEF_H
#define PAGS_PROXY_RELIEF_H

#include "exporters/proxy/background.h"
#include "exporters/proxy/planes.h"

/* States of cells, in this order. Measured: seen, and with a depth of its own. */
enum { PAGS_RELIEF_EMPTY, PAGS_RELIEF_FILLED, PAGS_RELIEF_SEEN, PAGS_RELIEF_MEASURED };

typedef struct pags_relief {
  pags_surface_plane plane;
  double cell;       /* side of a cell, metres */
  double depth;      /* distance of front and back where the back was not seen, metres */
  double u[3], v[3]; /* axes of the lattice: u level, v upwards; u x v is the plane's normal */
  double first[2];   /* u and v of the lower left corner of the first cell, in cells */
  int64_t n[2];      /* number of cells along u and v; cell (x, y) is at y * n[0] + x */
  uint8_t *state;
  float *front, *back; /* distance from the plane along its normal, metres */
  int64_t *part;       /* the first cell of the connected part that a cell belongs to; -1: none */
} pags_relief;

typedef struct pags_reliefs {
  int64_t count, capacity;
  pags_relief *list;
} pags_reliefs;

/* Makes the relief of the points that lie near `out->plane` and face as it does, and of what views see there, with
 * out->cell and out->depth. Parts of less than `least_area` square metres are left out; holes are closed; columns that
 * begin near the ground are continued down to it. There are no cells if there is no part. Cells before or behind parts
 * of the reliefs in `made` are only what their own points show: awnings, signs, balconies. After a failure, too, the
 * caller destroys `out`. */
pags_result pags_relief_make(const pags_surface_points *points, const pags_depth_views *views,
                             const pags_ground *ground, const pags_reliefs *made, double least_area, pags_tasks *tasks,
                             pags_relief *out);
void pags_relief_destroy(pags_relief *relief); /* frees and zeroes */

/* The part of a cell; -1 also beyond the lattice. */
int64_t pags_relief_part(const pags_relief *relief, int64_t x, int64_t y);

/* The point at x, y cells from the lower left corner of the lattice and `depth` metres from the plane. */
void pags_relief_point(const pags_relief *relief, double x, double y, double depth, double out[3]);

/* Leaves out the points on the relief's plane and in its parts. */
void pags_relief_take(const pags_relief *relief, pags_surface_points *points);

#endif
