/* SPDX-License-Identifier: Apache-2.0 */
/* Convex parts of a closed mesh, for engines of physics, which take convex shapes alone for bodies that move. */
#ifndef PAGS_PROXY_CONVEX_PARTS_H
#define PAGS_PROXY_CONVEX_PARTS_H

#include "exporters/proxy/mesh.h"

/* 124 triangles are 64 vertices, the most that PhysX takes for a hull on a graphics card. */
enum { PAGS_MOST_PARTS = 8, PAGS_PART_TRIANGLES = 124 };

typedef struct pags_convex_parts {
  int count;                     /* 0: the mesh isn't made of parts */
  int64_t ends[PAGS_MOST_PARTS]; /* part i has the triangles from the end of the part before it up to ends[i] */
} pags_convex_parts;

/* Makes up to PAGS_MOST_PARTS convex, closed parts of a closed mesh, together of at most `budget` triangles (12 or
 * more). No two parts share a vertex of `out`. PAGS_ERROR_ARGUMENT if it is flat. */
pags_result pags_proxy_mesh_convex(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out,
                                   pags_convex_parts *parts);

/* Copies one part. */
pags_result pags_convex_part(const pags_proxy_mesh *mesh, const pags_convex_parts *parts, int number,
                             pags_proxy_mesh *out);

/* Makes convex, closed meshes that together cover a closed mesh of several connected surfaces: of each its own parts,
 * or itself if it is convex. `out` receives a list of `count`; the caller destroys each and frees the list, after a
 * failure, too. */
pags_result pags_convex_meshes_make(const pags_proxy_mesh *mesh, pags_proxy_mesh **out, int64_t *count);

/* Makes convex, closed meshes that together cover a closed mesh of several connected surfaces: of each surface its own
 * parts, or itself if it is convex. `out` receives a list of `count`; the caller destroys each and frees the list,
 * after a failure, too. */
pags_result pags_convex_meshes_make(const pags_proxy_mesh *mesh, pags_proxy_mesh **out, int64_t *count);

#endif
