/* SPDX-License-Identifier: Apache-2.0 */
/* Extracts the zero surface of a TSDF by marching tetrahedra. Each cell of the grid is divided into six tetrahedra
 * about its long diagonal (Kuhn 1960), in the same way in all cells, so that the faces of neighbouring cells match. A
 * tetrahedron has no ambiguous case, so the surface has no holes. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/tsdf.h"

#include "base/memory.h"

/* The corners of the six tetrahedra. A corner of the cell is given by bits (1: +x, 2: +y, 4: +z); all tetrahedra have
 * positive volume. */
static const int tetrahedra[6][4] = {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7},
                                     {0, 3, 2, 7}, {0, 6, 4, 7}, {0, 5, 1, 7}};

/* Even permutations of a tetrahedron's four corners that put the one corner inside, or the two corners inside,
 * first. */
static const int one_first[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 0, 1, 3}, {3, 0, 2, 1}};
static const int two_first[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}, {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};

typedef struct marcher {
  const pags_tsdf *grid;
  pags_proxy_mesh *out;
  uint32_t *edges; /* for each point of two layers of the grid and each of the 7 edges that begin there: index + 1 of
                      the mesh vertex on that edge; 0: none yet */
  int64_t layer;   /* grid points in a layer of equal z */
} marcher;

typedef struct corner {
  int64_t point; /* index of the grid point */
  int bits;      /* which corner of the cell it is */
} corner;

/* Returns the mesh vertex on the edge between two corners, where the interpolated distance is zero; makes it if no
 * cell has yet. The edge is stored at the corner whose bits are a subset of the other's. */
static uint32_t vertex_on(marcher *m, const int cell[3], corner a, corner b) {
  const pags_tsdf *g = m->grid;
  if (a.bits > b.bits) {
    corner c = a;
    a = b;
    b = c;
  }
  int begin[3];
  for (int k = 0; k < 3; k++)
    begin[k] = cell[k] + (a.bits >> k & 1);
  int64_t slot = (begin[2] % 2 * m->layer + (int64_t)begin[1] * g->n[0] + begin[0]) * 7 + (a.bits ^ b.bits) - 1;
  if (m->edges[slot])
    return m->edges[slot] - 1;
  float da = g->distance[a.point], db = g->distance[b.point], grey[3] = {0.5f, 0.5f, 0.5f}, position[3];
  /* At least 2 % off the ends, so that vertices on edges that share a grid point never coincide. */
  double t = fmin(fmax((double)da / ((double)da - (double)db), 0.02), 0.98);
  for (int k = 0; k < 3; k++)
    position[k] = (float)(g->origin[k] + g->step * (begin[k] + t * ((a.bits ^ b.bits) >> k & 1)));
  uint32_t vertex = pags_proxy_mesh_vertex(m->out, position, grey, g->weight[a.point] > 0 && g->weight[b.point] > 0);
  m->edges[slot] = vertex + 1;
  return vertex;
}

/* Adds the one or two triangles of a tetrahedron with corners `c`; bit i of `inside` says that corner i is inside. */
static void march(marcher *m, const int cell[3], const corner c[4], int inside) {
  int count = (inside & 1) + (inside >> 1 & 1) + (inside >> 2 & 1) + (inside >> 3);
  if (count == 2) {
    const int *o = two_first[0];
    for (int i = 0; i < 6; i++)
      if (inside == (1 << two_first[i][0] | 1 << two_first[i][1]))
        o = two_first[i];
    uint32_t v[4] = {vertex_on(m, cell, c[o[0]], c[o[2]]), vertex_on(m, cell, c[o[0]], c[o[3]]),
                     vertex_on(m, cell, c[o[1]], c[o[3]]), vertex_on(m, cell, c[o[1]], c[o[2]])};
    pags_proxy_mesh_triangle(m->out, v[0], v[1], v[2]);
    pags_proxy_mesh_triangle(m->out, v[0], v[2], v[3]);
    return;
  }
  int alone = count == 1 ? inside : 15 - inside, first = 0;
  while (!(alone >> first & 1))
    first++;
  const int *o = one_first[first];
  uint32_t v[3];
  for (int i = 0; i < 3; i++)
    v[i] = vertex_on(m, cell, c[first], c[o[i + 1]]);
  pags_proxy_mesh_triangle(m->out, v[0], v[count == 1 ? 1 : 2], v[count == 1 ? 2 : 1]);
}

static void march_cell(marcher *m, const int cell[3], bool known_only) {
  const pags_tsdf *g = m->grid;
  corner corners[8];
  int inside = 0;
  for (int i = 0; i < 8; i++) {
    corners[i].bits = i;
    corners[i].point = ((int64_t)(cell[2] + (i >> 2)) * g->n[1] + cell[1] + (i >> 1 & 1)) * g->n[0] + cell[0] + (i & 1);
    if (known_only && !(g->weight[corners[i].point] > 0))
      return;
    inside |= (g->distance[corners[i].point] < 0) << i;
  }
  if (inside == 0 || inside == 255)
    return;
  for (int t = 0; t < 6; t++) {
    corner c[4];
    int mask = 0;
    for (int i = 0; i < 4; i++) {
      c[i] = corners[tetrahedra[t][i]];
      mask |= (inside >> tetrahedra[t][i] & 1) << i;
    }
    if (mask != 0 && mask != 15)
      march(m, cell, c, mask);
  }
}

pags_result pags_tsdf_surface(const pags_tsdf *grid, bool known_only, pags_proxy_mesh *out) {
  const int64_t layer = (int64_t)grid->n[0] * grid->n[1];
  const size_t layer_bytes = (size_t)layer * 7 * sizeof(uint32_t);
  PAGS_AUTOFREE uint32_t *edges = calloc(2, layer_bytes);
  marcher m = {grid, out, edges, layer};
  *out = (pags_proxy_mesh){0};
  PAGS_CHECK_MEMORY(edges, "a surface");
  int cell[3];
  for (cell[2] = 0; cell[2] + 1 < grid->n[2] && !out->failed; ++cell[2]) {
    for (cell[1] = 0; cell[1] + 1 < grid->n[1]; ++cell[1]) {
      const int64_t row = ((int64_t)(cell[2] / PAGS_GRID_BLOCK) * grid->blocks[1] + cell[1] / PAGS_GRID_BLOCK) *
                          grid->blocks[0]; /* the first block of the cells' row of blocks */
      for (cell[0] = 0; cell[0] + 1 < grid->n[0]; ++cell[0]) {
        if (known_only && grid->active && !grid->active[row + cell[0] / PAGS_GRID_BLOCK])
          cell[0] += PAGS_GRID_BLOCK - 1 - cell[0] % PAGS_GRID_BLOCK; /* a block that wasn't fused is unknown */
        else
          march_cell(&m, cell, known_only);
      }
    }
    /* The edges of this layer of points are done: their room is for the layer after next. */
    memset((char *)edges + (size_t)(cell[2] % 2) * layer_bytes, 0, layer_bytes);
  }
  return pags_proxy_mesh_check(out);
}
