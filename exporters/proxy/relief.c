/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the relief of a surface over an upright plane.
 *
 * A cell's front is the median of its points'. In cells without points, views tell whether there is a wall: Gaussians
 * lie up to a metre off it, too far for its place, but columns of a plane continue upwards and downwards. Gaps of up to
 * four cells and all holes that cells surround are closed. The front of cells without points is interpolated. */
#include "exporters/proxy/relief.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/mesh.h"

/* Cells by which gaps are closed from either side; sweeps of interpolation; measured cells around a column at which
 * views decide about it. */
enum { CLOSING = 2, SMOOTHINGS = 24, SUPPORT = 8 };

static const double reach = 0.45; /* a surface at most this far from the plane, in metres, is in its relief */
static const double half = 7;     /* extent of a relief to either side of its plane's middle along u, metres, */
static const double overlap = 1;  /* and this much further, where its neighbour begins, */
static const double facing = 0.5; /* least cosine between its normal and the plane's */
/* Distances behind the back within which points are left out, metres: any, and those that face along the plane's
 * normal. */
static const double behind = 0.15, inside = 3;
static const double highest = 4.5; /* a column that begins this high over the ground, in metres, ends there */
static const double rise = 15;     /* largest height above the points at which views decide about cells, metres */
static const double vague = 0.8;   /* depths of views are off by up to this, metres */
static const double sunk = 0.15;   /* blocks reach this deep into the ground, metres */

void pags_relief_destroy(pags_relief *relief) {
  free(relief->state);
  free(relief->front);
  free(relief->back);
  free(relief->part);
  *relief = (pags_relief){0};
}

int64_t pags_relief_part(const pags_relief *r, int64_t x, int64_t y) {
  return x >= 0 && y >= 0 && x < r->n[0] && y < r->n[1] ? r->part[y * r->n[0] + x] : -1;
}

void pags_relief_point(const pags_relief *r, double x, double y, double depth, double out[3]) {
  pags_scale3((r->first[0] + x) * r->cell, r->u, out);
  pags_add_scaled3((r->first[1] + y) * r->cell, r->v, out);
  pags_add_scaled3(r->plane.offset + depth, r->plane.normal, out);
}

/* A point in the relief's frame: u and v in cells, distance from the plane, cosine of the normals. */
typedef struct local {
  double x, y, depth, facing;
} local;

static local locate(const pags_relief *r, const pags_surface_points *points, int64_t i) {
  double p[3], n[3];
  pags_widen3(points->positions + 3 * i, p);
  pags_widen3(points->normals + 3 * i, n);
  return (local){pags_dot3(p, r->u) / r->cell - r->first[0], pags_dot3(p, r->v) / r->cell - r->first[1],
                 pags_dot3(p, r->plane.normal) - r->plane.offset, pags_dot3(n, r->plane.normal)};
}

/* The number of the cell that a point lies in; -1 beyond the lattice and in the cells of its border, which stay empty.
 */
static int64_t cell_of(const pags_relief *r, const local *p) {
  const double x = floor(p->x), y = floor(p->y);
  return x >= 1 && y >= 1 && x + 1 < (double)r->n[0] && y + 1 < (double)r->n[1] ? (int64_t)y * r->n[0] + (int64_t)x
                                                                                : -1;
}

/* ---- Depths ---- */

typedef struct mark {
  int64_t cell;
  float depth;
} mark;

static int compare_marks(const void *left, const void *right) {
  const mark *a = left, *b = right;
  if (a->cell != b->cell)
    return a->cell < b->cell ? -1 : 1;
  return (a->depth > b->depth) - (a->depth < b->depth);
}

/* Sets the axes of the lattice and its extent: that of the points which face as the plane does, and down by the height
 * that columns may be continued. */
static void place_lattice(const pags_surface_points *points, pags_relief *r) {
  double lo[2] = {HUGE_VAL, HUGE_VAL}, hi[2] = {-HUGE_VAL, -HUGE_VAL};
  const double *n = r->plane.normal;
  pags_copy3((const double[3]){-n[1], n[0], 0}, r->u);
  pags_cross3(n, r->u, r->v);
  const double middle = pags_dot3(r->plane.middle, r->u) / r->cell;
  for (int64_t i = 0; i < points->count; i++) {
    const local p = locate(r, points, i);
    if (!(fabs(p.depth) < reach && p.facing > facing && fabs(p.x - middle) < (half + overlap) / r->cell))
      continue;
    lo[0] = fmin(lo[0], p.x);
    hi[0] = fmax(hi[0], p.x);
    lo[1] = fmin(lo[1], p.y);
    hi[1] = fmax(hi[1], p.y);
  }
  if (lo[0] > hi[0])
    return;
  const double up = ceil(rise / r->cell), down = ceil((highest + 2) / r->cell);
  for (int k = 0; k < 2; k++) {
    r->first[k] = floor(lo[k]) - CLOSING - 1 - (k ? down : 0);
    r->n[k] = (int64_t)(floor(hi[k]) - r->first[k] + (k ? up : 0)) + CLOSING + 2;
  }
}

/* Sets cells to the median depth of the points that face as the plane does (side 1) or the other way (-1) and lie
 * between `lo` and `hi` metres from the plane. */
static pags_result take_medians(const pags_surface_points *points, int side, double lo, double hi, pags_relief *r) {
  PAGS_AUTOFREE mark *marks = NULL;
  int64_t count = 0, capacity = 0;
  for (int64_t i = 0; i < points->count; i++) {
    const local p = locate(r, points, i);
    const int64_t at = p.depth > lo && p.depth < hi && side * p.facing > facing ? cell_of(r, &p) : -1;
    if (at < 0 || (side < 0 && (r->state[at] == PAGS_RELIEF_EMPTY || p.depth > (double)r->front[at])))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&marks, count + 1, &capacity, sizeof *marks), "%lld points of a wall",
                      (long long)count + 1);
    marks[count++] = (mark){at, (float)p.depth};
  }
  pags_sort(marks, count, sizeof *marks, compare_marks);
  for (int64_t i = 0, end; i < count; i = end) {
    for (end = i + 1; end < count && marks[end].cell == marks[i].cell; end++)
      ;
    (side > 0 ? r->front : r->back)[marks[i].cell] = marks[(i + end) / 2].depth;
    if (side > 0)
      r->state[marks[i].cell] = PAGS_RELIEF_MEASURED;
  }
  return PAGS_OK;
}

/* Replaces the fronts of measured cells by the median of the measured ones in their 3 x 3 neighbourhood. */
static pags_result smooth(pags_relief *r) {
  const size_t size = (size_t)(r->n[0] * r->n[1]) * sizeof *r->front;
  PAGS_AUTOFREE float *before_it = malloc(size);
  PAGS_CHECK_MEMORY(before_it, "a relief");
  memcpy(before_it, r->front, size);
  for (int64_t y = 0; y < r->n[1]; y++)
    for (int64_t x = 0; x < r->n[0]; x++) {
      float around[9];
      int count = 0;
      for (int64_t j = y > 0 ? y - 1 : 0; j <= y + 1 && j < r->n[1]; j++)
        for (int64_t i = x > 0 ? x - 1 : 0; i <= x + 1 && i < r->n[0]; i++)
          if (r->state[j * r->n[0] + i] == PAGS_RELIEF_MEASURED)
            around[count++] = before_it[j * r->n[0] + i];
      pags_sort_floats(around, count);
      if (r->state[y * r->n[0] + x] == PAGS_RELIEF_MEASURED)
        r->front[y * r->n[0] + x] = around[count / 2];
    }
  return PAGS_OK;
}

/* ---- Shape ---- */

/* Finds the connected parts; cells of parts whose measured cells have less than `least_area` become empty. */
static pags_result find_parts(double least_area, pags_relief *r) {
  const int64_t nx = r->n[0], count = nx * r->n[1];
  PAGS_AUTOFREE double *area = calloc((size_t)count, sizeof *area);
  PAGS_CHECK_MEMORY(area, "a relief");
  for (int64_t i = 0; i < count; i++)
    r->part[i] = i;
  for (int64_t i = 0; i < count; i++) {
    if (r->state[i] == PAGS_RELIEF_EMPTY)
      continue;
    if (i % nx && r->state[i - 1] != PAGS_RELIEF_EMPTY)
      pags_set_join(r->part, i, i - 1);
    if (i >= nx && r->state[i - nx] != PAGS_RELIEF_EMPTY)
      pags_set_join(r->part, i, i - nx);
  }
  for (int64_t i = 0; i < count; i++)
    area[pags_set_root(r->part, i)] += r->state[i] == PAGS_RELIEF_MEASURED ? r->cell * r->cell : 0;
  for (int64_t i = count; i-- > 0;) { /* roots, which are smaller, stay until all others have been set */
    const int64_t root = pags_set_root(r->part, i);
    r->part[i] = area[root] >= least_area && r->state[i] != PAGS_RELIEF_EMPTY ? root : -1;
  }
  for (int64_t i = 0; i < count; i++)
    if (r->part[i] < 0)
      r->state[i] = PAGS_RELIEF_EMPTY;
  return PAGS_OK;
}

/* Closes gaps: cells become filled that lie between others, up to CLOSING cells away, along u or v. */
static void close_gaps(pags_relief *r) {
  for (int axis = 0; axis < 2; axis++) {
    const int64_t step = axis ? r->n[0] : 1;
    for (int64_t line = 0; line < r->n[!axis]; line++) {
      int64_t last = -1;
      for (int64_t i = 0; i < r->n[axis]; i++) {
        const int64_t at = line * (axis ? 1 : r->n[0]) + i * step;
        if (r->state[at] == PAGS_RELIEF_EMPTY)
          continue;
        for (int64_t k = last + 1; last >= 0 && i - last - 1 <= 2 * CLOSING && k < i; k++)
          r->state[at - (i - k) * step] = PAGS_RELIEF_FILLED;
        last = i;
      }
    }
  }
}

/* Marks the cells before or behind parts of other reliefs that face alike. */
static void find_claimed(const pags_reliefs *made, const pags_relief *r, uint8_t *claimed) {
  for (int64_t i = 0; i < made->count; i++) {
    const pags_relief *other = &made->list[i];
    if (!(pags_dot3(other->plane.normal, r->plane.normal) > facing))
      continue;
    for (int64_t at = 0; at < r->n[0] * r->n[1]; at++) {
      double p[3];
      pags_relief_point(r, (double)(at % r->n[0]) + 0.5, (double)(at / r->n[0]) + 0.5, 0, p);
      const local q = {pags_dot3(p, other->u) / other->cell - other->first[0],
                       pags_dot3(p, other->v) / other->cell - other->first[1],
                       pags_dot3(p, other->plane.normal) - other->plane.offset, 1};
      const int64_t cell = fabs(q.depth) < inside ? cell_of(other, &q) : -1;
      claimed[at] |= cell >= 0 && other->part[cell] >= 0;
    }
  }
}

/* Continues the columns of an upright plane down to the ground. */
static void reach_ground(const pags_ground *ground, const uint8_t *claimed, pags_relief *r) {
  for (int64_t x = 0; x < r->n[0]; x++) {
    int64_t low = 0;
    double p[3], z;
    while (low < r->n[1] && r->state[low * r->n[0] + x] == PAGS_RELIEF_EMPTY)
      low++;
    if (low == r->n[1])
      continue;
    pags_relief_point(r, (double)x + 0.5, (double)low, (double)r->front[low * r->n[0] + x], p);
    if (!pags_ground_nearest(ground, p[0], p[1], &z) || p[2] > z + highest)
      continue;
    for (int64_t y = low - 1; y > 0 && !claimed[y * r->n[0] + x] && (r->first[1] + (double)y + 1) * r->cell > z - sunk;
         y--)
      r->state[y * r->n[0] + x] = PAGS_RELIEF_FILLED;
  }
}

/* Fills all empty cells that others surround: those that no way over empty cells joins with the border, which is
 * empty. */
static void fill_holes(pags_relief *r, int64_t *queue) {
  const int64_t nx = r->n[0], count = nx * r->n[1];
  int64_t last = 0;
  memset(r->part, 0xff, (size_t)count * sizeof *r->part); /* 0: reached */
  queue[last++] = 0;
  r->part[0] = 0;
  for (int64_t head = 0; head < last; head++) {
    const int64_t x = queue[head] % nx, y = queue[head] / nx;
    const int64_t next[4] = {x > 0 ? queue[head] - 1 : -1, x + 1 < nx ? queue[head] + 1 : -1,
                             y > 0 ? queue[head] - nx : -1, y + 1 < r->n[1] ? queue[head] + nx : -1};
    for (int k = 0; k < 4; k++)
      if (next[k] >= 0 && r->part[next[k]] < 0 && r->state[next[k]] == PAGS_RELIEF_EMPTY) {
        r->part[next[k]] = 0;
        queue[last++] = next[k];
      }
  }
  for (int64_t i = 0; i < count; i++)
    if (r->part[i] < 0 && r->state[i] == PAGS_RELIEF_EMPTY)
      r->state[i] = PAGS_RELIEF_FILLED;
}

/* Fills cells until no two touch at a corner alone, where a solid's edge would have four faces. */
static void part_corners(pags_relief *r) {
  for (bool again = true; again;) {
    again = false;
    for (int64_t y = 0; y + 1 < r->n[1]; y++)
      for (int64_t x = 0; x + 1 < r->n[0]; x++) {
        uint8_t *s = r->state + y * r->n[0] + x, *above = s + r->n[0];
        const bool a = s[0] != 0, b = s[1] != 0, c = above[0] != 0, d = above[1] != 0;
        if (a != d || b != c || a == b)
          continue;
        *(a ? s + 1 : s) = PAGS_RELIEF_FILLED;
        again = true;
      }
  }
}

/* Interpolates the fronts of cells that are not measured: first that of the nearest measured cell, then means of
 * neighbours. */
static void interpolate(pags_relief *r, int64_t *queue) {
  const int64_t nx = r->n[0], count = nx * r->n[1], step[4] = {-1, 1, -nx, nx};
  int64_t last = 0;
  /* The border is empty, so that neighbours are within the lattice. */
  for (int64_t i = 0; i < count; i++) {
    r->part[i] = r->state[i] == PAGS_RELIEF_MEASURED ? 0 : -1;
    if (r->state[i] == PAGS_RELIEF_MEASURED)
      queue[last++] = i;
  }
  for (int64_t head = 0; head < last; head++)
    for (int k = 0; k < 4; k++) {
      const int64_t at = queue[head] + step[k];
      if (r->state[at] == PAGS_RELIEF_EMPTY || r->part[at] == 0)
        continue;
      r->part[at] = 0;
      r->front[at] = r->front[queue[head]];
      queue[last++] = at;
    }
  for (int sweep = 0; sweep < SMOOTHINGS; sweep++)
    for (int64_t i = 0; i < count; i++) {
      float sum = 0, weight = 0;
      const bool free = r->state[i] == PAGS_RELIEF_FILLED || r->state[i] == PAGS_RELIEF_SEEN;
      for (int k = 0; free && k < 4; k++)
        if (r->state[i + step[k]] != PAGS_RELIEF_EMPTY) {
          sum += r->front[i + step[k]];
          weight += 1;
        }
      if (weight > 0)
        r->front[i] = sum / weight;
    }
}

/* ---- What views see ---- */

typedef struct looking {
  const pags_depth_views *views;
  const uint8_t *supported, *claimed; /* of columns; of cells */
  pags_relief *relief;
} looking;

/* Asks all views about each cell of some columns: a cell is seen if the surface along the rays through it is near the
 * plane and of a building, and empty if more rays go on behind the plane. Rays that end before it say nothing, nor do
 * those that go on to a building behind a measured cell: Gaussians may lie metres behind their wall. */
static void look_at_columns(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const looking *l = context;
  pags_relief *r = l->relief;
  for (int64_t i = begin; i < end; i++)
    for (int64_t j = CLOSING; l->supported[i] && j < r->n[1] - 1; j++) {
      double p[3], eye[3], z;
      int near = 0, through = 0, x, y;
      if (l->claimed[j * r->n[0] + i])
        continue;
      pags_relief_point(r, (double)i + 0.5, (double)j + 0.5, 0, p);
      for (int64_t v = 0; v < l->views->count; v++) {
        const pags_depth_view *view = &l->views->list[v];
        if (!pags_depth_view_project(view, p, &x, &y, &z))
          continue;
        pags_pose_position(view->camera.world_from_camera, eye);
        if (!(pags_dot3(eye, r->plane.normal) - r->plane.offset > 0.15 * pags_distance3(eye, p)))
          continue;
        const int64_t pixel = (int64_t)y * view->camera.width + x;
        const double depth = (double)view->depth[pixel];
        const bool wall = !view->labels || pags_class_of_label(view->labels[pixel]) == PAGS_CHUNK_BUILDING;
        const bool measured = view->labels && wall && r->state[j * r->n[0] + i] == PAGS_RELIEF_MEASURED;
        if (depth > 0) {
          double q[3];
          pags_depth_view_point(view, x, y, depth, q);
          const double beyond = r->plane.offset - pags_dot3(q, r->plane.normal);
          near += wall && beyond > -vague && beyond < inside;
          through += !measured && beyond > (wall ? inside : vague);
        } else if (depth < 0) {
          through += !measured && -depth > z + vague;
        }
      }
      uint8_t *state = &r->state[j * r->n[0] + i];
      if (near >= 2 && near > through && *state == PAGS_RELIEF_EMPTY)
        *state = PAGS_RELIEF_SEEN;
      if (through > near)
        *state = PAGS_RELIEF_EMPTY;
    }
}

/* Looks at all columns that have enough points in them or next to them. */
static pags_result look(const pags_depth_views *views, const uint8_t *claimed, pags_tasks *tasks, pags_relief *r) {
  PAGS_AUTOFREE uint8_t *supported = calloc((size_t)r->n[0], 1);
  PAGS_CHECK_MEMORY(supported, "a relief");
  for (int64_t x = 1; x + 1 < r->n[0]; x++) {
    int count = 0;
    for (int64_t y = 0; y < r->n[1]; y++)
      for (int64_t i = x - 1; i <= x + 1; i++)
        count += r->state[y * r->n[0] + i] == PAGS_RELIEF_MEASURED;
    supported[x] = count >= SUPPORT;
  }
  looking l = {views, supported, claimed, r};
  return pags_proxy_for(tasks, r->n[0], 8, look_at_columns, &l);
}

/* Gives cells whose back was not seen the back of a neighbour where it was. */
static void spread_backs(pags_relief *r) {
  const int64_t nx = r->n[0], count = nx * r->n[1], step[4] = {-1, 1, -nx, nx};
  for (int64_t i = 0; i < count; i++)
    r->part[i] = r->state[i] != PAGS_RELIEF_EMPTY && r->back[i] > r->front[i] - (float)r->depth;
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 4 && r->state[i] != PAGS_RELIEF_EMPTY && !r->part[i]; k++)
      if (r->part[i + step[k]])
        r->back[i] = fmaxf(r->back[i], r->back[i + step[k]]);
}

/* ---- The relief ---- */

pags_result pags_relief_make(const pags_surface_points *points, const pags_depth_views *views,
                             const pags_ground *ground, const pags_reliefs *made, double least_area, pags_tasks *tasks,
                             pags_relief *r) {
  place_lattice(points, r);
  const int64_t count = r->n[0] * r->n[1];
  if (!count)
    return PAGS_OK;
  r->state = calloc((size_t)count, 1);
  r->front = calloc((size_t)count, sizeof *r->front);
  r->back = calloc((size_t)count, sizeof *r->back);
  r->part = calloc((size_t)count, sizeof *r->part);
  PAGS_AUTOFREE int64_t *queue = malloc((size_t)count * sizeof *queue);
  PAGS_AUTOFREE uint8_t *claimed = calloc((size_t)count, 1);
  PAGS_CHECK_MEMORY(r->state && r->front && r->back && r->part && queue && claimed, "a relief of %lld cells",
                    (long long)count);
  PAGS_TRY(take_medians(points, 1, -reach, reach, r));
  PAGS_TRY(smooth(r));
  find_claimed(made, r, claimed);
  PAGS_TRY(look(views, claimed, tasks, r));
  close_gaps(r);
  PAGS_TRY(find_parts(least_area, r));
  reach_ground(ground, claimed, r);
  fill_holes(r, queue);
  part_corners(r);
  interpolate(r, queue);
  for (int64_t i = 0; i < count; i++)
    r->back[i] = r->front[i] - (float)r->depth;
  PAGS_TRY(take_medians(points, -1, -reach - r->depth, reach, r));
  for (int pass = 0; pass < CLOSING; pass++)
    spread_backs(r);
  return find_parts(least_area, r);
}

void pags_relief_take(const pags_relief *r, pags_surface_points *points) {
  const int64_t count = r->n[0] * r->n[1];
  bool any = false;
  for (int64_t i = 0; i < count; i++)
    any = any || r->part[i] >= 0;
  const double middle = pags_dot3(r->plane.middle, r->u) / r->cell - r->first[0];
  int64_t kept = 0;
  /* Whether the wall continues beyond the overlap on a side: points in the overlap are then its neighbour's, too. */
  bool beyond[2] = {false, false};
  for (int64_t i = 0; i < points->count; i++) {
    const local p = locate(r, points, i);
    const double along = fabs(p.x - middle) * r->cell - half;
    if (along > overlap && along < 2 * overlap && p.facing > facing && fabs(p.depth) < reach)
      beyond[p.x > middle] = true;
  }
  for (int64_t i = 0; i < points->count; i++) {
    const local p = locate(r, points, i);
    const int64_t at = cell_of(r, &p);
    const bool reached = fabs(p.x - middle) * r->cell < half + (beyond[p.x > middle] ? 0 : overlap);
    /* Those on the plane, so that it isn't found again; if nothing came of it, all that made its relief. */
    const bool on = p.facing > facing && fabs(p.depth) < (any ? 0.5 : 1) * reach;
    const bool in = any && at >= 0 && r->part[at] >= 0 && p.depth < reach &&
                    p.depth > (double)r->back[at] - (fabs(p.facing) > facing ? inside : behind);
    if (reached && (on || in))
      continue;
    pags_copy3f(points->positions + 3 * i, points->positions + 3 * kept);
    pags_copy3f(points->normals + 3 * i, points->normals + 3 * kept);
    kept++;
  }
  points->count = kept;
}
