/* SPDX-License-Identifier: Apache-2.0 */
/* Meshes as growing arrays of vertices and quads, and functions that append boxes, tubes, ellipsoids and lofts. */
#include "synth/mesh.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

#define TWO_PI 6.2831853f

enum { MOST = 1 << 30 }; /* vertices and faces of a mesh */

/* ---- Vertices and faces ---- */

void pags_mesh_destroy(pags_mesh *mesh) {
  free(mesh->vertices);
  free(mesh->faces);
  free(mesh->materials);
  *mesh = (pags_mesh){0};
}

uint32_t pags_mesh_vertex(pags_mesh *mesh, const float position[3], const float normal[3], float u, float v) {
  if (mesh->vertex_count >= MOST ||
      !pags_grow(&mesh->vertices, mesh->vertex_count + 1, &mesh->vertex_capacity, sizeof *mesh->vertices)) {
    mesh->failed = true;
    return 0;
  }
  pags_vertex *out = &mesh->vertices[mesh->vertex_count];
  *out = (pags_vertex){.uv = {u, v}};
  pags_copy3f(position, out->position);
  if (normal)
    pags_copy3f(normal, out->normal);
  return (uint32_t)mesh->vertex_count++;
}

void pags_mesh_face(pags_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d, uint16_t material) {
  const int64_t count = mesh->face_count;
  int64_t capacity = mesh->face_capacity; /* of both lists */
  if (mesh->failed || count >= MOST || !pags_grow(&mesh->faces, count + 1, &capacity, 4 * sizeof *mesh->faces) ||
      !pags_grow(&mesh->materials, count + 1, &mesh->face_capacity, sizeof *mesh->materials)) {
    mesh->failed = true;
    return;
  }
  memcpy(mesh->faces + 4 * count, (uint32_t[4]){a, b, c, d}, 4 * sizeof *mesh->faces);
  mesh->materials[mesh->face_count++] = material;
}

/* ---- Quads and boxes ---- */

void pags_mesh_quad(pags_mesh *mesh, const float a[3], const float along[3], const float up[3], const float uv[2],
                    uint16_t material) {
  const float u = uv ? uv[0] : 0.0f, v = uv ? uv[1] : 0.0f;
  uint32_t corner[4];
  for (int i = 0; i < 4; i++) {
    const bool far = i == 1 || i == 2, high = i >= 2;
    float p[3];
    for (int k = 0; k < 3; k++)
      p[k] = a[k] + (far ? along[k] : 0.0f) + (high ? up[k] : 0.0f);
    corner[i] =
        pags_mesh_vertex(mesh, p, NULL, u + (far ? pags_length3f(along) : 0.0f), v + (high ? pags_length3f(up) : 0.0f));
  }
  pags_mesh_face(mesh, corner[0], corner[1], corner[2], corner[3], material);
}

void pags_mesh_box(pags_mesh *mesh, const float center[3], const float half[3], uint16_t material) {
  for (int axis = 0; axis < 3; axis++)
    for (int side = -1; side <= 1; side += 2) {
      const int next = axis == 2 ? 0 : axis == 0 ? 1 : 0, last = 3 - axis - next;
      float a[3], along[3] = {0}, up[3] = {0};
      pags_subtract3f(center, half, a);
      a[axis] = center[axis] + (float)side * half[axis];
      along[next] = 2.0f * half[next];
      up[last] = 2.0f * half[last];
      pags_mesh_quad(mesh, a, along, up, NULL, material);
    }
}

/* ---- Tubes and ellipsoids ---- */

static void end_cap(pags_mesh *mesh, const float center[3], const float x[3], const float y[3], float radius, int sides,
                    uint16_t material) {
  const uint32_t middle = pags_mesh_vertex(mesh, center, NULL, 0.0f, 0.0f);
  uint32_t first = 0, last = 0;
  for (int i = 0; i < sides; i++) {
    const float angle = TWO_PI * (float)i / (float)sides;
    float p[3];
    for (int k = 0; k < 3; k++)
      p[k] = center[k] + radius * (pags_cosf(angle) * x[k] + pags_sinf(angle) * y[k]);
    const uint32_t at = pags_mesh_vertex(mesh, p, NULL, 0.0f, 0.0f);
    if (i)
      pags_mesh_face(mesh, middle, last, at, at, material);
    else
      first = at;
    last = at;
  }
  pags_mesh_face(mesh, middle, last, first, first, material);
}

void pags_mesh_tube(pags_mesh *mesh, const float from[3], const float to[3], float radius_from, float radius_to,
                    int sides, uint16_t material) {
  float axis[3], x[3], y[3];
  pags_subtract3f(to, from, axis);
  const float height = pags_normalise3f(axis);

  /* x and y: unit vectors perpendicular to the unit vector `axis` and to each other. */
  const float other[3] = {fabsf(axis[2]) > 0.9f ? 1.0f : 0.0f, 0.0f, fabsf(axis[2]) > 0.9f ? 0.0f : 1.0f};
  pags_cross3f(other, axis, x);
  pags_normalise3f(x);
  pags_cross3f(axis, x, y);

  const uint32_t base = (uint32_t)mesh->vertex_count;
  for (int i = 0; i < sides; i++) {
    const float angle = TWO_PI * (float)i / (float)sides;
    float n[3], low[3], high[3];
    for (int k = 0; k < 3; k++)
      n[k] = pags_cosf(angle) * x[k] + pags_sinf(angle) * y[k];
    pags_along3f(from, radius_from, n, low);
    pags_along3f(to, radius_to, n, high);
    const float u = TWO_PI * radius_from * (float)i / (float)sides;
    pags_mesh_vertex(mesh, low, n, u, 0.0f);
    pags_mesh_vertex(mesh, high, n, u, height);
  }
  for (int i = 0; i < sides; i++) {
    const uint32_t a = base + 2 * (uint32_t)i, b = base + 2 * (uint32_t)((i + 1) % sides);
    pags_mesh_face(mesh, a, b, b + 1, a + 1, material);
  }
  end_cap(mesh, from, x, y, radius_from, sides, material);
  end_cap(mesh, to, x, y, radius_to, sides, material);
}

void pags_mesh_ellipsoid(pags_mesh *mesh, const float center[3], const float radii[3], int slices, uint16_t material) {
  const int stacks = (slices + 1) / 2 + 1;
  const uint32_t base = (uint32_t)mesh->vertex_count;
  for (int i = 0; i <= stacks; i++)
    for (int j = 0; j < slices; j++) {
      const float polar = 0.5f * TWO_PI * (float)i / (float)stacks, around = TWO_PI * (float)j / (float)slices;
      const float unit[3] = {pags_sinf(polar) * pags_cosf(around), pags_sinf(polar) * pags_sinf(around),
                             pags_cosf(polar)};
      float p[3], n[3];
      for (int k = 0; k < 3; k++) {
        p[k] = center[k] + radii[k] * unit[k];
        n[k] = unit[k] / radii[k];
      }
      pags_normalise3f(n);
      pags_mesh_vertex(mesh, p, n, (float)j, (float)i);
    }
  for (int i = 0; i < stacks; i++)
    for (int j = 0; j < slices; j++) {
      const uint32_t row = base + (uint32_t)(i * slices), j0 = (uint32_t)j, j1 = (uint32_t)((j + 1) % slices);
      pags_mesh_face(mesh, row + j0, row + j1, row + (uint32_t)slices + j1, row + (uint32_t)slices + j0, material);
    }
}

/* ---- Lofts ---- */

static void close_ring(pags_mesh *mesh, const float *ring, int columns, uint16_t material) {
  float middle[3] = {0};
  for (int i = 0; i < columns; i++)
    for (int k = 0; k < 3; k++)
      middle[k] += ring[3 * i + k] / (float)columns;
  const uint32_t center = pags_mesh_vertex(mesh, middle, NULL, 0.0f, 0.0f), first = center + 1;
  for (int i = 0; i < columns; i++)
    pags_mesh_vertex(mesh, ring + 3 * i, NULL, 0.0f, 0.0f);
  for (int i = 0; i < columns; i++) {
    const uint32_t next = first + (uint32_t)((i + 1) % columns);
    pags_mesh_face(mesh, center, first + (uint32_t)i, next, next, material);
  }
}

void pags_mesh_loft(pags_mesh *mesh, int rings, int columns, const float *points,
                    uint16_t (*material_of)(void *user, int ring, int column), void *user) {
  const uint32_t base = (uint32_t)mesh->vertex_count;
  for (int i = 0; i < rings; i++)
    for (int j = 0; j < columns; j++) {
      float normal[3];

      /* The vertex normal is the cross product of the differences between neighbours along the ring and between
       * rings. It need not point outwards, since tracing turns normals towards the ray. */
      const int before = i ? i - 1 : 0, after = i + 1 < rings ? i + 1 : i;
      const float *left = points + 3 * (i * columns + (j + columns - 1) % columns);
      const float *right = points + 3 * (i * columns + (j + 1) % columns);
      const float *low = points + 3 * (before * columns + j), *high = points + 3 * (after * columns + j);
      float across[3], along[3];
      pags_subtract3f(right, left, across);
      pags_subtract3f(high, low, along);
      pags_cross3f(across, along, normal);
      pags_normalise3f(normal);

      pags_mesh_vertex(mesh, points + 3 * (i * columns + j), normal, (float)j, (float)i);
    }
  for (int i = 0; i + 1 < rings; i++)
    for (int j = 0; j < columns; j++) {
      const uint32_t row = base + (uint32_t)(i * columns), j0 = (uint32_t)j, j1 = (uint32_t)((j + 1) % columns);
      pags_mesh_face(mesh, row + j0, row + j1, row + (uint32_t)columns + j1, row + (uint32_t)columns + j0,
                     material_of(user, i, j));
    }
  close_ring(mesh, points, columns, material_of(user, -1, 0));
  close_ring(mesh, points + 3 * (size_t)(rings - 1) * (size_t)columns, columns, material_of(user, rings - 1, 0));
}
