/* SPDX-License-Identifier: Apache-2.0 */
/* A triangle mesh in the making: positions, colours, and which parts some camera saw. */
#ifndef PAGS_PROXY_MESH_H
#define PAGS_PROXY_MESH_H

#include <pags/base.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_proxy_mesh {
  int64_t vertex_count, vertex_capacity, triangle_count, triangle_capacity;
  float *positions;    /* 3 a vertex, metres */
  float *colors;       /* 3 a vertex, display-referred sRGB 0..1 */
  uint8_t *observed;   /* 1 a vertex: 1 seen by a camera, 0 completed */
  uint32_t *triangles; /* 3 a triangle, counter-clockwise from outside */
  bool failed;         /* memory ran out: the surface lacks parts */
} pags_proxy_mesh;

void pags_proxy_mesh_destroy(pags_proxy_mesh *mesh); /* frees and zeroes; a zeroed struct is allowed */
/* PAGS_ERROR_MEMORY where `failed` is set. */
pags_result pags_proxy_mesh_check(const pags_proxy_mesh *mesh);

uint32_t pags_proxy_mesh_vertex(pags_proxy_mesh *mesh, const float position[3], const float color[3], int observed);
/* Left out where two corners are the same. */
void pags_proxy_mesh_triangle(pags_proxy_mesh *mesh, uint32_t a, uint32_t b, uint32_t c);
pags_result pags_proxy_mesh_copy(const pags_proxy_mesh *from, pags_proxy_mesh *to);

/* Keeps vertices that triangles use, in the order of their first use. */
pags_result pags_proxy_mesh_compact(pags_proxy_mesh *mesh);

/* The box of this size about the origin: 8 vertices, 12 triangles. */
pags_result pags_proxy_mesh_box(const double size[3], const float color[3], pags_proxy_mesh *out);

/* Keeps the largest connected part (by area), those with at least `share` of its area, and what else isn't a crumb,
 * lies in the box of this size about the origin and comes closer to those than `reach` metres: wing mirrors, whose arms
 * are too thin to be seen. NULL: nothing else. */
pags_result pags_proxy_mesh_keep_parts(pags_proxy_mesh *mesh, double share, double reach, const double *size);

/* Drops connected parts of less than `area` square metres. */
pags_result pags_proxy_mesh_drop_floaters(pags_proxy_mesh *mesh, double area);

typedef struct pags_proxy_mesh_topology {
  int64_t open_edges;    /* with one face */
  int64_t crossed_edges; /* with more than two, or two that run the same way */
  double volume;         /* signed, as if closed */
  bool closed;           /* no such edges, positive volume, not empty */
} pags_proxy_mesh_topology;
pags_result pags_proxy_mesh_inspect(const pags_proxy_mesh *mesh, pags_proxy_mesh_topology *out);

/* Takes out faces that cover each other and cuts edges of more than two faces apart by doubling vertices. */
pags_result pags_proxy_mesh_repair(pags_proxy_mesh *mesh);

double pags_proxy_mesh_area(const pags_proxy_mesh *mesh);
void pags_proxy_mesh_normals(const pags_proxy_mesh *mesh, float *normals); /* by area; 3 a vertex, unit length */

/* At most `budget` triangles (meshoptimizer). A closed surface stays closed: where a collapse would break it, it is
 * made from a coarser one until it holds. */
pags_result pags_proxy_mesh_simplify(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

/* The convex hull of its vertices, of at most `budget` triangles (the hull of the farthest points in evenly spread
 * directions). PAGS_ERROR_ARGUMENT when they all lie in a plane. */
pags_result pags_proxy_mesh_hull(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
