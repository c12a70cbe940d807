/* SPDX-License-Identifier: Apache-2.0 */
/* Approximate convex decomposition (Lien and Amato 2007) of a closed mesh by cuts along its axes, as V-HACD makes them
 * (Mamou 2016), but without voxels.
 *
 * A part is what a box holds of the solid. Its hull is that of the mesh's vertices in the box, of the points where
 * triangles meet the box's faces and edges, and of the box's corners inside of the solid. The part whose hull holds
 * most that isn't solid is cut in two, where the halves' hulls are smallest together, or, of places about as good,
 * where the halves are alike: the hole of a ring is only reached by the second cut. */
#include "exporters/proxy/convex_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

enum {
  CUTS = 8,               /* a part is cut at multiples of an eighth of its hull's extents */
  ROUGH_TRIANGLES = 1500, /* of the mesh that is cut */
  COLUMNS = 32,           /* lines a side that measure the solid */
  MOST_CROSSINGS = 16     /* of one line with the surface */
};
static const double enough = 0.02;  /* of the whole hull's volume: what a hull may hold that isn't solid */
static const double unlike = 0.05;  /* price of halves that differ, for each cubic metre of solid that they do */
static const double between = 1e-5; /* of the whole's extents: half the gap between halves. A wall in the cut's plane
                                       belongs to the side that it is the wall of */

typedef struct part {
  double box[2][3]; /* lowest and highest corner */
  bool solid[8]; /* whether the box's corners are inside of the mesh; bit k of the number: at the high end of axis k */
  pags_proxy_mesh hull; /* empty if the part is */
  double volume;        /* of the hull */
  double filled;        /* of the solid in the box */
} part;

/* A line along x through the mesh: where it meets the surface, ascending, in pairs of going in and out. */
typedef struct column {
  int count;
  double x[MOST_CROSSINGS];
} column;

/* The mesh that is cut, and columns on a lattice over its extents in y and z, by which the solid is measured. */
typedef struct body {
  pags_proxy_mesh mesh;
  double box[2][3];
  column *columns; /* row of z by row */
  int64_t budget;  /* triangles of a hull */
} body;

/* ---- How much of a box is solid ---- */

static void forget_body(body *b) {
  pags_proxy_mesh_destroy(&b->mesh);
  free(b->columns);
}

/* The range of lattice lines of one axis (1: y, 2: z) that may meet lo..hi. */
static void lines_between(const body *b, int axis, double lo, double hi, int range[2]) {
  const double step = (b->box[1][axis] - b->box[0][axis]) / COLUMNS;
  range[0] = (int)fmax(0, floor((lo - b->box[0][axis]) / step - 0.5));
  range[1] = (int)fmin(COLUMNS - 1, ceil((hi - b->box[0][axis]) / step - 0.5));
}

static void add_crossings_of_triangle(body *b, double v[3][3]) {
  const double area = (v[1][1] - v[0][1]) * (v[2][2] - v[0][2]) - (v[2][1] - v[0][1]) * (v[1][2] - v[0][2]);
  int range[2][2];
  if (area == 0)
    return;
  for (int k = 0; k < 2; k++)
    lines_between(b, k + 1, fmin(v[0][k + 1], fmin(v[1][k + 1], v[2][k + 1])),
                  fmax(v[0][k + 1], fmax(v[1][k + 1], v[2][k + 1])), range[k]);
  for (int z = range[1][0]; z <= range[1][1]; z++)
    for (int y = range[0][0]; y <= range[0][1]; y++) {
      const double at[2] = {b->box[0][1] + (b->box[1][1] - b->box[0][1]) * (y + 0.5) / COLUMNS - v[0][1],
                            b->box[0][2] + (b->box[1][2] - b->box[0][2]) * (z + 0.5) / COLUMNS - v[0][2]};
      const double p = (at[0] * (v[2][2] - v[0][2]) - (v[2][1] - v[0][1]) * at[1]) / area;
      const double q = ((v[1][1] - v[0][1]) * at[1] - at[0] * (v[1][2] - v[0][2])) / area;
      column *const line = &b->columns[z * COLUMNS + y];
      if (p >= 0 && q >= 0 && p + q <= 1 && line->count < MOST_CROSSINGS)
        line->x[line->count++] = v[0][0] + p * (v[1][0] - v[0][0]) + q * (v[2][0] - v[0][0]);
    }
}

/* How much of lo..hi is in the lattice's interval `i` of an axis. */
static double overlap(const body *b, int axis, int i, double lo, double hi) {
  const double step = (b->box[1][axis] - b->box[0][axis]) / COLUMNS, begin = b->box[0][axis] + i * step;
  return fmax(0, fmin(hi, begin + step) - fmax(lo, begin));
}

static double filled_volume(const body *b, double box[2][3]) {
  double sum = 0;
  for (int z = 0; z < COLUMNS; z++)
    for (int y = 0; y < COLUMNS; y++) {
      const column *const line = &b->columns[z * COLUMNS + y];
      double length = 0;
      for (int i = 0; i + 1 < line->count; i += 2)
        length += fmax(0, fmin(line->x[i + 1], box[1][0]) - fmax(line->x[i], box[0][0]));
      sum += length * overlap(b, 1, y, box[0][1], box[1][1]) * overlap(b, 2, z, box[0][2], box[1][2]);
    }
  return sum;
}

/* ---- The points of a part ---- */

static bool in_box(const part *p, const double v[3]) {
  for (int k = 0; k < 3; k++)
    if (v[k] < p->box[0][k] || v[k] > p->box[1][k])
      return false;
  return true;
}

static void corner_of(const part *p, int number, double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = p->box[number >> k & 1][k];
}

/* Whether a point is inside of a closed mesh, by the solid angles of its triangles (Van Oosterom and Strackee 1983). */
static bool is_inside(const pags_proxy_mesh *mesh, const double at[3]) {
  double sum = 0;
  for (int64_t t = 0; t < mesh->triangle_count; t++) {
    double v[3][3], length[3], cross[3];
    pags_proxy_mesh_corners(mesh, t, v);
    for (int i = 0; i < 3; i++) {
      pags_subtract3(v[i], at, v[i]);
      length[i] = pags_length3(v[i]);
    }
    pags_cross3(v[1], v[2], cross);
    sum +=
        pags_atan2(pags_dot3(v[0], cross), length[0] * length[1] * length[2] + pags_dot3(v[0], v[1]) * length[2] +
                                               pags_dot3(v[1], v[2]) * length[0] + pags_dot3(v[2], v[0]) * length[1]);
  }
  return sum > 3.14159265358979323846; /* half of all angles: 2 pi inside, 0 outside */
}

/* Cuts off what of a polygon lies beyond one face of the box (Sutherland and Hodgman 1974). Returns how many corners
 * are left. */
static int clip(double polygon[9][3], int count, int axis, double limit, bool high) {
  double out[9][3];
  int kept = 0;
  for (int i = 0; i < count; i++) {
    const double *const a = polygon[i], *const b = polygon[(i + 1) % count];
    const double da = high ? limit - a[axis] : a[axis] - limit, db = high ? limit - b[axis] : b[axis] - limit;
    if (da >= 0)
      memcpy(out[kept++], a, sizeof out[0]);
    if ((da < 0) != (db < 0)) {
      for (int k = 0; k < 3; k++)
        out[kept][k] = a[k] + (b[k] - a[k]) * (da / (da - db));
      out[kept++][axis] = limit;
    }
  }
  memcpy(polygon, out, sizeof out);
  return kept;
}

static void add_point(pags_proxy_mesh *cloud, const double at[3], const pags_proxy_mesh *mesh, uint32_t like) {
  float position[3];
  pags_narrow3(at, position);
  pags_proxy_mesh_vertex(cloud, position, mesh->colors + 3 * (int64_t)like, mesh->observed[like]);
}

/* Adds where a triangle that isn't all inside meets the box. Points get the colour of the triangle's first corner. */
static void add_crossings(pags_proxy_mesh *cloud, const pags_proxy_mesh *mesh, const part *p, int64_t triangle) {
  double polygon[9][3]; /* three corners, and at most one more for each of six faces */
  int count = 3;
  pags_proxy_mesh_corners(mesh, triangle, polygon);
  if (in_box(p, polygon[0]) && in_box(p, polygon[1]) && in_box(p, polygon[2]))
    return;
  for (int face = 0; face < 6 && count; face++)
    count = clip(polygon, count, face % 3, p->box[face / 3][face % 3], face >= 3);
  for (int i = 0; i < count; i++)
    add_point(cloud, polygon[i], mesh, mesh->triangles[3 * triangle]);
}

/* Makes the hull of what the part's box holds; none if that is flat or nothing. */
static pags_result make_hull(const body *b, part *p) {
  const pags_proxy_mesh *const mesh = &b->mesh;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh cloud = {0};
  pags_proxy_mesh_topology topology;
  double at[3];
  p->hull = (pags_proxy_mesh){0};
  p->volume = 0;
  p->filled = filled_volume(b, p->box);
  for (uint32_t i = 0; i < mesh->vertex_count; i++) {
    pags_proxy_mesh_point(mesh, i, at);
    if (in_box(p, at))
      add_point(&cloud, at, mesh, i);
  }
  for (int64_t t = 0; t < mesh->triangle_count; t++)
    add_crossings(&cloud, mesh, p, t);
  for (int i = 0; i < 8; i++) {
    corner_of(p, i, at);
    if (p->solid[i])
      add_point(&cloud, at, mesh, 0);
  }
  PAGS_TRY(pags_proxy_mesh_check(&cloud));
  if (cloud.vertex_count < 4)
    return PAGS_OK;
  const pags_result result = pags_proxy_mesh_hull(&cloud, b->budget, &p->hull);
  if (result == PAGS_ERROR_ARGUMENT) /* all in a plane */
    return PAGS_OK;
  PAGS_TRY(result);
  PAGS_TRY(pags_proxy_mesh_inspect(&p->hull, &topology));
  p->volume = topology.volume;
  return PAGS_OK;
}

/* ---- Cuts ---- */

static pags_result cut(const body *b, const part *whole, int axis, double at, part halves[2]) {
  const double gap = between * (b->box[1][axis] - b->box[0][axis]);
  pags_result result = PAGS_OK;
  for (int h = 0; h < 2; h++) {
    halves[h] = *whole;
    halves[h].hull = (pags_proxy_mesh){0};
    halves[h].box[1 - h][axis] = h ? at + gap : at - gap;
    for (int i = 0; i < 8; i++) { /* the corners that are new */
      double corner[3];
      corner_of(&halves[h], i, corner);
      if ((i >> axis & 1) != h)
        halves[h].solid[i] = is_inside(&b->mesh, corner);
    }
    if (result == PAGS_OK)
      result = make_hull(b, &halves[h]);
  }
  return result;
}

static void destroy_halves(part halves[2]) {
  pags_proxy_mesh_destroy(&halves[0].hull);
  pags_proxy_mesh_destroy(&halves[1].hull);
}

/* Makes the best cut of a part; of equals the first. The caller frees the halves, also after a failure. */
static pags_result cut_best(const body *b, const part *whole, part halves[2]) {
  double box[2][3], least = HUGE_VAL, best_at = 0;
  int best_axis = 0;
  pags_proxy_mesh_bounds(&whole->hull, box[0], box[1]);
  for (int axis = 0; axis < 3; axis++)
    for (int i = 1; i < CUTS; i++) {
      const double at = box[0][axis] + (box[1][axis] - box[0][axis]) * i / CUTS;
      const pags_result result = cut(b, whole, axis, at, halves);
      const double price = halves[0].volume + halves[1].volume + unlike * fabs(halves[0].filled - halves[1].filled);
      if (result != PAGS_OK)
        return result;
      destroy_halves(halves);
      if (price < least) {
        least = price;
        best_axis = axis;
        best_at = at;
      }
    }
  return cut(b, whole, best_axis, best_at, halves);
}

typedef struct part_list {
  part parts[PAGS_MOST_PARTS];
  int count;
} part_list;

static void forget_parts(part_list *l) {
  for (int i = 0; i < l->count; i++)
    pags_proxy_mesh_destroy(&l->parts[i].hull);
}

/* Cuts the body into at most `most` parts. */
static pags_result decompose(const body *b, int most, part_list *l) {
  part *const parts = l->parts;
  memcpy(parts[0].box, b->box, sizeof b->box);
  l->count = 1;
  PAGS_TRY(make_hull(b, &parts[0]));
  const double whole = parts[0].volume;
  while (l->count < most) {
    part halves[2];
    int worst = 0;
    for (int i = 1; i < l->count; i++)
      worst = parts[i].volume - parts[i].filled > parts[worst].volume - parts[worst].filled ? i : worst;
    if (!(parts[worst].volume - parts[worst].filled > enough * whole))
      break;
    const pags_result result = cut_best(b, &parts[worst], halves);
    if (result != PAGS_OK)
      destroy_halves(halves);
    PAGS_TRY(result);
    pags_proxy_mesh_destroy(&parts[worst].hull);
    parts[worst] = halves[0];
    parts[l->count++] = halves[1];
  }
  return PAGS_OK;
}

/* ---- The parts as one mesh ---- */

pags_result pags_proxy_mesh_convex(const pags_proxy_mesh *from, int64_t budget, pags_proxy_mesh *out,
                                   pags_convex_parts *parts) {
  const int most = budget / 12 < PAGS_MOST_PARTS ? (int)(budget / 12) : PAGS_MOST_PARTS;
  PAGS_AUTO(forget_body)
  body b = {.budget = budget / most < PAGS_PART_TRIANGLES ? budget / most : PAGS_PART_TRIANGLES};
  PAGS_AUTO(forget_parts) part_list list = {0};
  *out = (pags_proxy_mesh){0};
  parts->count = 0;
  /* Simplify the mesh, and measure it along lines. */
  PAGS_TRY(pags_proxy_mesh_simplify(from, ROUGH_TRIANGLES, &b.mesh));
  b.columns = calloc(COLUMNS * COLUMNS, sizeof *b.columns);
  PAGS_CHECK_MEMORY(b.columns, "convex parts");
  pags_proxy_mesh_bounds(&b.mesh, b.box[0], b.box[1]);
  for (int64_t t = 0; t < b.mesh.triangle_count; t++) {
    double v[3][3];
    pags_proxy_mesh_corners(&b.mesh, t, v);
    add_crossings_of_triangle(&b, v);
  }
  for (int i = 0; i < COLUMNS * COLUMNS; i++)
    pags_sort_doubles(b.columns[i].x, b.columns[i].count);
  PAGS_TRY(decompose(&b, most, &list));
  for (int i = 0; i < list.count; i++) {
    pags_proxy_mesh *hull = &list.parts[i].hull;
    if (!hull->triangle_count)
      continue;
    PAGS_TRY(pags_proxy_mesh_clean(hull));
    PAGS_TRY(pags_proxy_mesh_append(hull, out));
    parts->ends[parts->count++] = out->triangle_count;
  }
  return parts->count ? PAGS_OK : pags_fail(PAGS_ERROR_ARGUMENT, "no convex parts: the surface is flat");
}

pags_result pags_convex_part(const pags_proxy_mesh *mesh, const pags_convex_parts *parts, int number,
                             pags_proxy_mesh *out) {
  const int64_t begin = number ? parts->ends[number - 1] : 0;
  return pags_proxy_mesh_copy_part(mesh, mesh->triangles + 3 * begin, parts->ends[number] - begin, out);
}
