/* SPDX-License-Identifier: Apache-2.0 */
/* The triangle mesh of all proxies: positions, colours, and for each vertex whether some camera saw it. Functions
 * build meshes, inspect and repair their topology, decimate them, and make convex hulls and cages. A function that
 * makes a mesh `out` may leave a part of it there when it fails: the caller destroys it in either case. */
#ifndef PAGS_PROXY_MESH_H
#define PAGS_PROXY_MESH_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/vec3.h"

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
pags_result pags_proxy_mesh_copy(const pags_proxy_mesh *from, pags_proxy_mesh *out);
/* Copies only these `count` triangles, given by vertices of `from`, and the vertices that they use. */
pags_result pags_proxy_mesh_copy_part(const pags_proxy_mesh *from, const uint32_t *triangles, int64_t count,
                                      pags_proxy_mesh *out);
/* Appends all vertices and triangles of another mesh. */
pags_result pags_proxy_mesh_append(const pags_proxy_mesh *from, pags_proxy_mesh *to);

/* The position of a vertex; those of a triangle's corners; the cross product of two edges of a triangle, which is its
 * normal with twice its area as length; the box that holds all vertices. */
static inline void pags_proxy_mesh_point(const pags_proxy_mesh *mesh, int64_t vertex, double out[3]) {
  pags_widen3(mesh->positions + 3 * vertex, out);
}
void pags_proxy_mesh_corners(const pags_proxy_mesh *mesh, int64_t triangle, double out[3][3]);
void pags_proxy_mesh_cross(const pags_proxy_mesh *mesh, int64_t triangle, double out[3]);
void pags_proxy_mesh_bounds(const pags_proxy_mesh *mesh, double lo[3], double hi[3]);
/* The mean of a triangle's corners, each divided by three before they are added. */
void pags_proxy_mesh_middle(const pags_proxy_mesh *mesh, int64_t triangle, double out[3]);
/* Removes the triangles whose first vertex is UINT32_MAX. */
void pags_proxy_mesh_drop_marked(pags_proxy_mesh *mesh);

/* Union-find over numbers that begin as their own parents: the representative of a set, its smallest number, and the
 * union of two sets. */
int64_t pags_set_root(int64_t *parent, int64_t i);
void pags_set_join(int64_t *parent, int64_t a, int64_t b);
/* Makes sets of the vertices that triangles connect: the parts of a mesh. parent: one per vertex, overwritten. */
void pags_proxy_mesh_connect(const pags_proxy_mesh *mesh, int64_t *parent);

/* Removes vertices that no triangle uses and puts the others in the order of their first use. */
pags_result pags_proxy_mesh_compact(pags_proxy_mesh *mesh);

/* Makes a box of this size (metres) centred at the origin: 8 vertices, 12 triangles. */
pags_result pags_proxy_mesh_box(const double size[3], const float color[3], pags_proxy_mesh *out);

/* Adds a closed prism between two polygons of `sides` corners each. Seen from the second one's side, both run
 * counter-clockwise. `observed` is that of the first one's corners and of the second one's. */
void pags_proxy_mesh_prism(pags_proxy_mesh *mesh, int sides, double (*first)[3], double (*second)[3],
                           const float color[3], const bool observed[2]);

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

/* Makes a closed slab of a sheet that faces up: adds a lower side `depth` metres below it, and a rim. */
pags_result pags_proxy_mesh_thicken(pags_proxy_mesh *mesh, double depth);

/* Area-weighted vertex normals of unit length, 3 floats a vertex. */
void pags_proxy_mesh_normals(const pags_proxy_mesh *mesh, float *normals);

/* Makes vertices one whose positions are equal when rounded to steps of `tolerance` metres, and drops the triangles
 * that collapse by that. */
pags_result pags_proxy_mesh_weld(pags_proxy_mesh *mesh, double tolerance);

/* Decimates a mesh to at most `budget` triangles with meshoptimizer. A closed mesh stays closed: if the repaired
 * result is not closed or too large, the decimation is repeated with fewer triangles. PAGS_ERROR_LIMIT if no try
 * succeeds. */
pags_result pags_proxy_mesh_simplify(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

/* Decimates a mesh, which may be open, as far as the surface moves by at most about `error` metres. Vertices at the
 * same place stay together. */
pags_result pags_proxy_mesh_simplify_within(const pags_proxy_mesh *from, double error, pags_proxy_mesh *out);

/* Makes the convex hull of a mesh's vertices, of at most `budget` triangles: only the farthest vertices in evenly
 * spread directions are used. PAGS_ERROR_ARGUMENT if they all lie in a plane. */
pags_result pags_proxy_mesh_hull(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out);

/* Writes positions and triangles as a binary PLY file (mesh_ply.c). PAGS_ERROR_IO; PAGS_ERROR_MEMORY. */
pags_result pags_mesh_ply_save(const char *path, const pags_proxy_mesh *mesh);

/* Fits a closed control cage of quads to a closed mesh, such that the cage's subdivision surface (Catmull and Clark
 * 1978) lies on the mesh. `level` 0: `out` is the cage itself; 1..3: the cage subdivided that many times, its vertices
 * moved to the limit surface. Each quad becomes two triangles, at most `budget` triangles in all (but no fewer than
 * 12 * 4^level, a cube's). */
pags_result pags_proxy_mesh_cage(const pags_proxy_mesh *mesh, int level, int64_t budget, pags_proxy_mesh *out);

#ifdef __cplusplus
}
#endif
#endif
