/* SPDX-License-Identifier: Apache-2.0 */
/* Nearest points of a triangle mesh or a point cloud, and first hits of rays on a mesh, through Embree. */
#ifndef PAGS_PROXY_MESH_QUERY_H
#define PAGS_PROXY_MESH_QUERY_H

#include "base/memory.h"
#include "exporters/proxy/mesh.h"

typedef struct pags_mesh_query pags_mesh_query;

/* Builds a query over the triangles of `mesh`, which must outlive the query. */
pags_result pags_mesh_query_of_mesh(const pags_proxy_mesh *mesh, pags_mesh_query **out);
/* Builds a query over points of 3 floats each, which must outlive the query. */
pags_result pags_mesh_query_of_points(const float *points, int64_t count, pags_mesh_query **out);
void pags_mesh_query_destroy(pags_mesh_query *query); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_mesh_query, pags_mesh_query_destroy)

/* The queries below may be called by several threads at once. Returns the distance from `point` to the nearest
 * triangle or point, infinite without any; `primitive` (may be NULL) receives its index. */
double pags_mesh_query_distance(const pags_mesh_query *query, const double point[3], uint32_t *primitive);
/* As pags_mesh_query_distance, but `nearest` receives the nearest point on the mesh or of the cloud. */
double pags_mesh_query_nearest(const pags_mesh_query *query, const double point[3], double nearest[3]);
/* The first triangle that a ray hits. Returns the ray parameter t, where the hit is origin + t direction; negative:
 * no hit. `primitive` (may be NULL) receives the triangle's index. */
double pags_mesh_query_ray(const pags_mesh_query *query, const double origin[3], const double direction[3],
                           uint32_t *primitive);

#endif
