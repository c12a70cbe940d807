/* SPDX-License-Identifier: Apache-2.0 */
/* Distances to triangles or points, and rays against triangles, through Embree. */
#ifndef PAGS_PROXY_MESH_QUERY_H
#define PAGS_PROXY_MESH_QUERY_H

#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_mesh_query pags_mesh_query;

/* `mesh` must outlive it. */
pags_result pags_mesh_query_of_mesh(const pags_proxy_mesh *mesh, pags_mesh_query **out);
/* 3 floats a point, which must outlive it. */
pags_result pags_mesh_query_of_points(const float *points, int64_t count, pags_mesh_query **out);
void pags_mesh_query_destroy(pags_mesh_query *query); /* NULL is allowed */

/* By several threads at once. Distance to the nearest triangle or point; infinite when there is none. `primitive` may
 * be NULL. */
double pags_mesh_query_distance(const pags_mesh_query *query, const double point[3], uint32_t *primitive);
/* The nearest point itself; same return. */
double pags_mesh_query_nearest(const pags_mesh_query *query, const double point[3], double nearest[3]);
/* First triangle along the ray, in lengths of the direction; negative: none. */
double pags_mesh_query_ray(const pags_mesh_query *query, const double origin[3], const double direction[3],
                           uint32_t *primitive);

#ifdef __cplusplus
}
#endif
#endif
