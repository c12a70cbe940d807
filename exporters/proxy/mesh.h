/* SPDX-License-Identifier: Apache-2.0 */
/* The triangle mesh of all proxies: positions, colours, and for each vertex whether some camera saw it. Functions
 * build meshes, inspect and repair their topology, decimate them and make convex hulls. */
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
  uint8_t *observed;   /* 1 a vertex: 1: seen by a camera; 0: completed by the shape prior or filled in */
  uint32_t *triangles; /* 3 a triangle, counter-clockwise from outside */
  bool failed;         /* out of memory: vertices or triangles are missing */
} pags_proxy_mesh;

void pags_proxy_mesh_destroy(pags_proxy_mesh *mesh); /* frees and zeroes; a zeroed struct is allowed */
/* Returns PAGS_ERROR_MEMORY if `failed` is set. */
pags_result pags_proxy_mesh_check(const pags_proxy_mesh *mesh);

uint32_t pags_proxy_mesh_vertex(pags_proxy_mesh *mesh, const float position[3], const float color[3], int observed);
/* Adds a triangle, unless two of its corners are the same vertex. */
void pags_proxy_mesh_triangle(pags_proxy_mesh *mesh, uint32_t a, uint32_t b, uint32_t c);
pags_result pags_proxy_mesh_copy(const pags_proxy_mesh *from, pags_proxy_mesh *to);

/* Removes vertices that no triangle uses and puts the others in the order of their first use. */
pags_result pags_proxy_mesh_compact(pags_proxy_mesh *mesh);

/* Makes a box of this size (metres) centred at the origin: 8 vertices, 12 triangles. */
pags_result pags_proxy_mesh_box(const double size[3], const float color[3], pags_proxy_mesh *out);

/* Keeps connected components whose area is at least `share` of the largest component's, and removes the others as
 * floaters. If `size` is given, smaller components are kept, too, that have a vertex in the box of that size about
 * the origin closer than `reach` metres to a large component, unless they are tiny: wing mirrors, whose arms are too
 * thin to be reconstructed. `size` NULL: no smaller ones are kept. */
pags_result pags_proxy_mesh_keep_parts(pags_proxy_mesh *mesh, double share, double reach, const double *size);

/* Removes connected components of less than `area` square metres. */
pags_result pags_proxy_mesh_drop_floaters(pags_proxy_mesh *mesh, double area);

typedef struct pags_proxy_mesh_topology {
  int64_t open_edges;    /* edges of one face */
  int64_t crossed_edges; /* edges of more than two faces, or of two that run along the edge in the same direction */
  double volume;         /* signed volume, cubic metres; meaningful if the mesh is closed */
  bool closed;           /* there are no open and no crossed edges, the volume is positive, the mesh isn't empty */
} pags_proxy_mesh_topology;
pags_result pags_proxy_mesh_inspect(const pags_proxy_mesh *mesh, pags_proxy_mesh_topology *out);

/* Makes a decimated mesh closed again: removes pairs of faces that cover each other, and cuts edges of more than two
 * faces apart by doubling vertices. */
pags_result pags_proxy_mesh_repair(pags_proxy_mesh *mesh);

/* Removes triangles without area, double ones, and edges of more than two faces, also where vertices at the same place
 * count as one. A closed mesh stays closed: if it can't, it is left as it was. */
pags_result pags_proxy_mesh_clean(pags_proxy_mesh *mesh);

double pags_proxy_mesh_area(const pags_proxy_mesh *mesh);
/* Area-weighted vertex normals of unit length, 3 floats a vertex. */
void pags_proxy_mesh_normals(const pags_proxy_mesh *mesh, float *normals);

/* Decimates a mesh to at most `budget` triangles with meshoptimizer. A closed mesh stays closed: if the repaired
 * result is not closed or too large, the decimation is repeated with fewer triangles. PAGS_ERROR_LIMIT if no try
 * succeeds. */
pags_result pags_proxy_mesh_simplify(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

/* Makes the convex hull of a mesh's vertices, of at most `budget` triangles: only the farthest vertices in evenly
 * spread directions are used. PAGS_ERROR_ARGUMENT if they all lie in a plane. */
pags_result pags_proxy_mesh_hull(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
