/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes of quads (a triangle is a quad whose last corner is repeated) for the synthetic scenes, put together from
 * boxes, tubes, ellipsoids and lofts. Lengths in metres. */
#ifndef PAGS_SYNTH_MESH_H
#define PAGS_SYNTH_MESH_H

#include <stdbool.h>
#include <stdint.h>

typedef struct pags_vertex {
  float position[3];
  float normal[3]; /* for smooth shading; zero: the face's normal is used */
  float uv[2];     /* texture coordinates of finishes that follow the surface (material.h) */
} pags_vertex;

typedef struct pags_mesh {
  pags_vertex *vertices;
  uint32_t *faces;     /* 4 vertex indices a face, in order around it */
  uint16_t *materials; /* material number of each face */
  int64_t vertex_count, vertex_capacity, face_count, face_capacity;
  bool failed; /* out of memory: some vertices or faces are missing */
} pags_mesh;

void pags_mesh_destroy(pags_mesh *mesh);

/* Appends a vertex and returns its index; `normal` may be NULL for flat shading. */
uint32_t pags_mesh_vertex(pags_mesh *mesh, const float position[3], const float normal[3], float u, float v);
void pags_mesh_face(pags_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d, uint16_t material);

/* Adds a quad with corners a, a + along, a + along + up, a + up. Its texture coordinates begin at `uv` (NULL: 0, 0)
 * at corner a and grow by the lengths of the edges. */
void pags_mesh_quad(pags_mesh *mesh, const float a[3], const float along[3], const float up[3], const float uv[2],
                    uint16_t material);
void pags_mesh_box(pags_mesh *mesh, const float center[3], const float half[3], uint16_t material);
/* Adds a cylinder or truncated cone with flat ends. */
void pags_mesh_tube(pags_mesh *mesh, const float from[3], const float to[3], float radius_from, float radius_to,
                    int sides, uint16_t material);
void pags_mesh_ellipsoid(pags_mesh *mesh, const float center[3], const float radii[3], int slices, uint16_t material);
/* Adds the surface through `rings` closed rings of `columns` points each (3 floats a point). Neighbouring rings are
 * joined by smoothly shaded quads, the first and the last ring are closed by fans. `material_of` returns the material
 * of the face between ring and ring + 1 at a column; ring -1 and rings - 1 ask for the fans'. */
void pags_mesh_loft(pags_mesh *mesh, int rings, int columns, const float *points,
                    uint16_t (*material_of)(void *user, int ring, int column), void *user);

#endif
