/* SPDX-License-Identifier: Apache-2.0 */
/* Makes closed blocks of buildings and walls.
 *
 * Upright planes are found one by one, the largest first (planes.h), in the LiDAR points of walls, or without those in
 * the fused surface (wall_points.h). A relief (relief.h) of what was measured and seen near the plane is continued to
 * the ground. Each connected part of it, cut into pieces of limited length, becomes a solid between the front that was
 * seen and a back at a fixed depth behind it, or at the surface that was seen from the other side: closed by
 * construction. Points of it are then left out, and the next plane is sought in the rest. */
#include "exporters/proxy/blocks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/relief.h"
#include "exporters/proxy/wall_points.h"

enum { MOST_PLANES = 2000, MOST_TRIANGLES = 500 };

static const double least_cell = 0.2;  /* side of a relief's cells, metres; more if the voxels are larger */
static const double least_plane = 1.0; /* a plane of less area makes no block, square metres */
static const double least_piece = 0.4; /* the same for a connected part */
static const double longest = 17;      /* length of a block, metres */
static const double thin = 0.05;       /* least distance of front and back, metres */
static const double wall_depth = 0.5;  /* of the unseen part of blocks, metres */

/* ---- Solids ---- */

/* A part of a relief between two columns, and the solid that is made of it. */
typedef struct solid {
  const pags_relief *relief;
  int64_t part, from, to;
  uint32_t *place[2]; /* vertices of the front and the back at each corner of cells; UINT32_MAX: none yet */
  pags_proxy_mesh mesh;
} solid;

static void forget_solid(solid *s) {
  free(s->place[0]);
  free(s->place[1]);
  pags_proxy_mesh_destroy(&s->mesh);
}

static bool within(const solid *s, int64_t x, int64_t y) {
  return x >= s->from && x < s->to && pags_relief_part(s->relief, x, y) == s->part;
}

/* The vertex at the lower left corner of a cell, at the mean depth of the part's cells around it. */
static uint32_t corner(solid *s, int64_t x, int64_t y, int behind) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const pags_relief *r = s->relief;
  uint32_t *place = &s->place[behind][y * (r->n[0] + 1) + x];
  double front = 0, back = 0, p[3];
  int count = 0, seen = 0;
  if (*place != UINT32_MAX)
    return *place;
  for (int64_t j = y - 1; j <= y; j++)
    for (int64_t i = x - 1; i <= x; i++)
      if (pags_relief_part(r, i, j) == s->part) {
        const int64_t at = j * r->n[0] + i;
        front += (double)r->front[at];
        back += (double)r->back[at];
        seen += r->state[at] >= PAGS_RELIEF_SEEN;
        count++;
      }
  front /= count;
  back = fmin(back / count, front - thin);
  pags_relief_point(r, (double)x, (double)y, behind ? back : front, p);
  float q[3];
  pags_narrow3(p, q);
  return *place = pags_proxy_mesh_vertex(&s->mesh, q, grey, !behind && seen);
}

static void quad(pags_proxy_mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  pags_proxy_mesh_triangle(mesh, a, b, c);
  pags_proxy_mesh_triangle(mesh, a, c, d);
}

/* Adds the front and the back of a cell, and its sides where the part ends. */
static void add_cell(solid *s, int64_t x, int64_t y) {
  static const int dx[4] = {0, 1, 1, 0}, dy[4] = {0, 0, 1, 1};       /* corners, counter-clockwise */
  static const int sides[4][2] = {{0, -1}, {1, 0}, {0, 1}, {-1, 0}}; /* the cell beyond the edge from corner k */
  uint32_t front[4], back[4];
  for (int k = 0; k < 4; k++) {
    front[k] = corner(s, x + dx[k], y + dy[k], 0);
    back[k] = corner(s, x + dx[k], y + dy[k], 1);
  }
  quad(&s->mesh, front[0], front[1], front[2], front[3]);
  quad(&s->mesh, back[3], back[2], back[1], back[0]);
  for (int k = 0; k < 4; k++)
    if (!within(s, x + sides[k][0], y + sides[k][1]))
      quad(&s->mesh, front[(k + 1) % 4], front[k], back[k], back[(k + 1) % 4]);
}

/* Makes the solid of the part's columns from..to - 1 and appends it as a chunk. */
static pags_result add_piece(const pags_proxy_maker *w, pags_background *b, const pags_relief *r, int64_t part,
                             int64_t from, int64_t to) {
  const size_t corners = (size_t)((r->n[0] + 1) * (r->n[1] + 1));
  PAGS_AUTO(forget_solid) solid s = {.relief = r, .part = part, .from = from, .to = to};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh simple = {0};
  double area = 0, seen = 0, n[3];
  for (int k = 0; k < 2; k++) {
    s.place[k] = malloc(corners * sizeof *s.place[k]);
    PAGS_CHECK_MEMORY(s.place[k], "a block of %zu corners", corners);
    memset(s.place[k], 0xff, corners * sizeof *s.place[k]);
  }
  for (int64_t y = 0; y < r->n[1]; y++)
    for (int64_t x = from; x < to; x++)
      if (within(&s, x, y)) {
        add_cell(&s, x, y);
        seen += r->state[y * r->n[0] + x] >= PAGS_RELIEF_SEEN ? r->cell * r->cell : 0;
      }
  PAGS_TRY(pags_proxy_mesh_check(&s.mesh));
  if (!(seen >= least_piece))
    return PAGS_OK;
  for (int64_t i = 0; i < s.mesh.triangle_count; i++) {
    pags_proxy_mesh_cross(&s.mesh, i, n);
    area += 0.5 * pags_length3(n);
  }
  pags_result result = PAGS_ERROR_LIMIT;
  for (int64_t budget = MOST_TRIANGLES; result == PAGS_ERROR_LIMIT; budget *= 2)
    result = pags_proxy_mesh_simplify(&s.mesh, budget, &simple);
  PAGS_TRY(result);
  PAGS_TRY(pags_proxy_mesh_drop_floaters(&simple, 2 * least_piece)); /* slivers, front and back */
  if (!simple.triangle_count)
    return PAGS_OK;
  PAGS_TRY(pags_proxy_mesh_paint(&simple, &b->depth_views, 3 * w->options->voxel, w->tasks));
  PAGS_TRY(pags_background_add(b, pags_class_names[PAGS_CHUNK_BUILDING], &simple));
  b->chunks[b->chunk_count - 1].unseen_depth = r->depth;
  b->chunks[b->chunk_count - 1].observed = fmin(seen / area, 1);
  return PAGS_OK;
}

/* Makes blocks of all parts of a relief. */
static pags_result add_parts(const pags_proxy_maker *w, pags_background *b, const pags_relief *r) {
  PAGS_AUTOFREE int64_t *ends = malloc((size_t)(2 * r->n[0] * r->n[1] + 1) * sizeof *ends);
  PAGS_CHECK_MEMORY(ends, "a relief");
  /* The first and the last column of each part, which is named by its first cell. */
  for (int64_t i = 0; i < r->n[0] * r->n[1]; i++) {
    const int64_t part = r->part[i], x = i % r->n[0];
    if (part < 0)
      continue;
    ends[2 * part] = part == i || x < ends[2 * part] ? x : ends[2 * part];
    ends[2 * part + 1] = part == i || x > ends[2 * part + 1] ? x : ends[2 * part + 1];
  }
  for (int64_t i = 0; i < r->n[0] * r->n[1]; i++)
    if (r->part[i] == i) {
      const int64_t first = ends[2 * i], columns = ends[2 * i + 1] + 1 - first,
                    pieces = (int64_t)ceil((double)columns * r->cell / longest);
      for (int64_t k = 0; k < pieces; k++)
        PAGS_TRY(add_piece(w, b, r, i, first + columns * k / pieces, first + columns * (k + 1) / pieces));
    }
  return PAGS_OK;
}

/* ---- All planes ---- */

static void forget_reliefs(pags_reliefs *reliefs) {
  for (int64_t i = 0; i < reliefs->count; i++)
    pags_relief_destroy(&reliefs->list[i]);
  free(reliefs->list);
}

/* Makes blocks of the planes in some points, which are used up. */
static pags_result add_planes(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground, double cell,
                              pags_surface_points *points) {
  PAGS_AUTO(forget_reliefs) pags_reliefs made = {0};
  for (int64_t round = 0; round < MOST_PLANES; round++) {
    PAGS_AUTO(pags_relief_destroy) pags_relief r = {.cell = cell, .depth = wall_depth};
    double area;
    PAGS_TRY(pags_surface_plane_find(points, round, w->tasks, &r.plane, &area));
    if (!(area >= least_plane))
      break;
    PAGS_TRY(pags_relief_make(points, &b->depth_views, ground, &made, least_plane, w->tasks, &r));
    PAGS_TRY(add_parts(w, b, &r));
    pags_relief_take(&r, points);
    PAGS_CHECK_MEMORY(pags_grow(&made.list, made.count + 1, &made.capacity, sizeof *made.list), "a relief");
    made.list[made.count++] = r;
    r = (pags_relief){0};
  }
  return PAGS_OK;
}

pags_result pags_blocks_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                             pags_proxy_mesh *joined) {
  const double cell = fmax(least_cell, 4.0 / 3 * w->options->voxel);
  PAGS_AUTO(pags_surface_points_destroy) pags_surface_points points = {0};
  if (b->labelled)
    PAGS_TRY(pags_wall_points_of_lidar(w, b, ground, 0.5 * cell, &points));
  if (!points.count)
    PAGS_TRY(pags_wall_points_of_surface(joined, 0.5 * cell, &points));
  return add_planes(w, b, ground, cell, &points);
}
