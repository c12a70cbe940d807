/* A triangle mesh in the making: positions, colours, and which parts some camera saw. */
#ifndef PAGS_EXPORTERS_SURFACE_H
#define PAGS_EXPORTERS_SURFACE_H

#include <pags/base.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_surface {
  int64_t vertex_count, vertex_capacity, triangle_count, triangle_capacity;
  float *positions;   /* 3 a vertex, metres */
  float *colors;      /* 3 a vertex, display-referred sRGB 0..1 */
  uint8_t *observed;  /* 1 a vertex: 1 seen by a camera, 0 completed */
  uint32_t *triangles; /* 3 a triangle, counter-clockwise from outside */
  bool failed;        /* memory ran out: the surface lacks parts */
} pags_surface;

void pags_surface_destroy(pags_surface *surface); /* frees and zeroes; a zeroed struct is allowed */
/* PAGS_ERROR_MEMORY where `failed` is set. */
pags_result pags_surface_check(const pags_surface *surface);

uint32_t pags_surface_vertex(pags_surface *surface, const float position[3], const float color[3], int observed);
/* Left out where two corners are the same. */
void pags_surface_triangle(pags_surface *surface, uint32_t a, uint32_t b, uint32_t c);
pags_result pags_surface_copy(const pags_surface *from, pags_surface *to);

/* Keeps vertices that triangles use, in the order of their first use. */
pags_result pags_surface_compact(pags_surface *surface);

/* The box of this size about the origin: 8 vertices, 12 triangles. */
pags_result pags_surface_box(const double size[3], const float color[3], pags_surface *out);

/* Keeps the largest connected part (by area) and those with at least `share` of its area. */
pags_result pags_surface_keep_parts(pags_surface *surface, double share);

typedef struct pags_surface_topology {
  int64_t open_edges;   /* with one face */
  int64_t crossed_edges; /* with more than two, or two that run the same way */
  double volume;        /* signed, as if closed */
  bool closed;          /* no such edges, positive volume, not empty */
} pags_surface_topology;
pags_result pags_surface_inspect(const pags_surface *surface, pags_surface_topology *out);

/* Takes out faces that cover each other and cuts edges of more than two faces apart by doubling vertices. */
pags_result pags_surface_repair(pags_surface *surface);

double pags_surface_area(const pags_surface *surface);
void pags_surface_normals(const pags_surface *surface, float *normals); /* by area; 3 a vertex, unit length */

/* At most `budget` triangles (meshoptimizer). A closed surface stays closed: where a collapse would break it, it is
 * made from a coarser one until it holds. */
pags_result pags_surface_simplify(const pags_surface *from, int64_t budget, pags_surface *out);

/* The convex hull of its vertices, of at most `budget` triangles (the hull of the farthest points in evenly spread directions).
 * PAGS_ERROR_ARGUMENT when they all lie in a plane. */
pags_result pags_surface_hull(const pags_surface *from, int64_t budget, pags_surface *out);

#ifdef __cplusplus
}
#endif
#endif
