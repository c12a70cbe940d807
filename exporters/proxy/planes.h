/* SPDX-License-Identifier: Apache-2.0 */
/* Upright planes in a surface given by points with normals: walls. */
#ifndef PAGS_PROXY_PLANES_H
#define PAGS_PROXY_PLANES_H

#include <pags/base.h>
#include <pags/tasks.h>

typedef struct pags_surface_plane {
  double normal[3]; /* level, of unit length, out of the solid */
  double offset;    /* dot(normal, p) of the points p on the plane, metres */
  double middle[3]; /* where it was found: it was fitted to points near there */
} pags_surface_plane;

/* Points spread evenly over a surface. */
typedef struct pags_surface_points {
  int64_t count, capacity;
  float *positions, *normals; /* 3 a point: metres; unit length, out of the solid */
  double area;                /* of the surface around one point, square metres */
} pags_surface_points;

/* Finds the upright plane that most points lie on, over some metres. `area` receives the area of those points, 0 if
 * there are no points. `round`, another number for each call, chooses the candidates. The same bits for any number of
 * threads. */
pags_result pags_surface_plane_find(const pags_surface_points *points, int64_t round, pags_tasks *tasks,
                                    pags_surface_plane *out, double *area);

#endif
