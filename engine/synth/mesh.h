/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes of quads (a triangle repeats its last corner), built from simple bodies. Metres. */
#ifndef PAGS_SYNTH_MESH_H
#define PAGS_SYNTH_MESH_H

#include <stdbool.h>
#include <stdint.h>

typedef struct pags_vertex {
  float position[3];
  float normal[3]; /* for smooth shading; zero: the face's own */
  float uv[2];     /* for textures that follow the surface */
} pags_vertex;

typedef struct pags_mesh {
  pags_vertex *vertices;
  uint32_t *faces;     /* 4 a face: corners going around */
  uint16_t *materials; /* one a face */
  int64_t vertex_count, vertex_capacity, face_count, face_capacity;
  bool failed; /* memory ran out: the mesh lacks parts */
} pags_mesh;

void pags_mesh_destroy(pags_mesh *mesh);

/* Returns the vertex's number; `normal` may be NULL. */
uint32_t pags_mesh_vertex(pags_mesh *mesh, const float position[3], const float normal[3], float u, float v);
void pags_mesh_face(pags_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d, uint16_t material);

/* Corners a, a + along, a + along + up, a + up; uv runs from `uv` by the edges' lengths (NULL: from 0, 0). */
void pags_mesh_quad(pags_mesh *mesh, const float a[3], const float along[3], const float up[3], const float uv[2],
                    uint16_t material);
void pags_mesh_box(pags_mesh *mesh, const float center[3], const float half[3], uint16_t material);
/* A cylinder or cone with flat ends. */
void pags_mesh_tube(pags_mesh *mesh, const float from[3], const float to[3], float radius_from, float radius_to,
                    int sides, uint16_t material);
void pags_mesh_ellipsoid(pags_mesh *mesh, const float center[3], const float radii[3], int slices, uint16_t material);
/* Rings of `columns` points each that go around; neighbours are joined and shaded smoothly, the first and the last ring
 * closed by fans. `material_of` gives a face's by ring and column. */
void pags_mesh_loft(pags_mesh *mesh, int rings, int columns, const float *points,
                    uint16_t (*material_of)(void *user, int ring, int column), void *user);

#endif
