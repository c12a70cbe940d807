/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of trees.
 *
 * The vertices of vegetation are counted in the cells of a lattice in x and y. Cells that touch form a wood. In a wood
 * with trunks each cell belongs to the nearest one; without, to a peak of the canopy: cells join in the order of their
 * heights, and two peaks stay separate if the saddle between them is low (persistence, Edelsbrunner et al. 2002). A
 * crown is filled between its lowest and highest vertices, divided by k-means (Lloyd 1982), and each part gets its
 * hull. */
#include "exporters/proxy/background.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/tsdf.h"
#include "maths/maths.h"

enum {
  LEAST_VERTICES = 2, /* in a cell of the canopy */
  LEAST_CELLS = 8,    /* of a tree: half a square metre */
  ROUNDS = 12,        /* of k-means */
  HULL_TRIANGLES = 60
};

/* In metres. */
static const double cell = 0.25;           /* side of a cell of the canopy */
static const double lowest = 0.3;          /* height above the ground: vegetation below is the ground's */
static const double prominence = 1;        /* of a peak above the saddle to a higher one */
static const double widest_hill = 6;       /* distance of a cell, or of another peak, from a peak that they join */
static const double trunk_reach = 4.5;     /* distance of a crown's cells from its trunk */
static const double least_tree = 2;        /* height of a tree */
static const double clear_stem = 1;        /* height of a crown's foot above which there is a trunk, seen or not */
static const double default_radius = 0.15; /* of a trunk that wasn't seen */
static const double slice = 0.25;          /* height of the slices by which a crown's foot is found */
static const double around_trunk = 0.5;    /* distance from the trunk of vertices that may be its own */
static const double foot_share = 0.15;     /* of the widest slice's vertices: the crown begins */
static const double voxel = 0.3;           /* in which a crown is filled */
static const double hull_volume = 4;       /* cubic metres of a crown for each hull */

static const double leaf_gap = 0.15; /* by which hulls are smaller than the surface */
static const double sink = 0.03;     /* how far a trunk reaches into the ground */

/* ---- The canopy ---- */

typedef struct canopy {
  double x0, y0;
  int64_t nx, ny;
  int32_t *vertices; /* number of them in each cell */
  float *height;     /* of the highest one above the ground */
  int64_t *owner;    /* number of the tree; -1: none */
  int64_t *parent;   /* union-find */
  int64_t *order;    /* of cells */
  int64_t trees;
} canopy;

static void forget_canopy(canopy *c) {
  void *const owned[] = {c->vertices, c->height, c->owner, c->parent, c->order};
  for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
    free(owned[i]);
}

static int64_t cell_of(const canopy *c, const double p[3]) {
  const double i = floor((p[0] - c->x0) / cell), j = floor((p[1] - c->y0) / cell);
  return i >= 0 && j >= 0 && i < (double)c->nx && j < (double)c->ny ? (int64_t)j * c->nx + (int64_t)i : -1;
}

static bool is_canopy(const canopy *c, int64_t at) {
  return c->vertices[at] >= LEAST_VERTICES;
}

/* Sets `heights` of the vertices above the ground, -1: none near or too low, and counts them in cells. */
static pags_result make_canopy(const pags_ground *ground, const pags_proxy_mesh *joined, float *heights, canopy *out) {
  double lo[3], hi[3];
  pags_proxy_mesh_bounds(joined, lo, hi);
  for (int k = 0; k < 3 && !joined->vertex_count; k++)
    lo[k] = hi[k] = 0;
  out->x0 = lo[0];
  out->y0 = lo[1];
  out->nx = (int64_t)((hi[0] - lo[0]) / cell) + 1;
  out->ny = (int64_t)((hi[1] - lo[1]) / cell) + 1;
  const size_t cells = (size_t)(out->nx * out->ny) + 1;
  out->vertices = calloc(cells, sizeof *out->vertices);
  out->height = calloc(cells, sizeof *out->height);
  out->owner = malloc(cells * sizeof *out->owner);
  out->parent = malloc(cells * sizeof *out->parent);
  out->order = malloc(cells * sizeof *out->order);
  PAGS_CHECK_MEMORY(out->vertices && out->height && out->owner && out->parent && out->order, "%zu cells", cells);
  for (int64_t i = 0; i < joined->vertex_count; i++) {
    double p[3], z;
    pags_proxy_mesh_point(joined, i, p);
    heights[i] = pags_ground_nearest(ground, p[0], p[1], &z) && p[2] - z >= lowest ? (float)(p[2] - z) : -1;
    if (heights[i] < 0)
      continue;
    const int64_t at = cell_of(out, p);
    out->vertices[at]++;
    out->height[at] = fmaxf(out->height[at], heights[i]);
  }
  for (size_t i = 0; i < cells; i++) {
    out->owner[i] = -1;
    out->parent[i] = (int64_t)i;
  }
  return PAGS_OK;
}

/* The neighbour of a cell in one of eight directions; -1 outside. */
static int64_t neighbour(const canopy *c, int64_t at, int direction) {
  static const int dx[8] = {1, -1, 0, 0, 1, -1, 1, -1}, dy[8] = {0, 0, 1, -1, 1, -1, -1, 1};
  const int64_t x = at % c->nx + dx[direction], y = at / c->nx + dy[direction];
  return x >= 0 && y >= 0 && x < c->nx && y < c->ny ? y * c->nx + x : -1;
}

/* Gives each cell near a trunk to the nearest one. The number of a tree is that of its trunk among the columns. */
static void grow_from_trunks(canopy *c, const pags_background *b) {
  const pags_columns *columns = &b->columns;
  for (int64_t at = 0; at < c->nx * c->ny; at++) {
    double nearest = trunk_reach;
    for (int64_t i = 0; i < columns->count && is_canopy(c, at); i++) {
      const pags_column *t = &columns->list[i];
      const double x = c->x0 + ((double)(at % c->nx) + 0.5) * cell, y = c->y0 + ((double)(at / c->nx) + 0.5) * cell;
      double stem[3];
      if (pags_column_kind_of(t, b->labelled) != PAGS_COLUMN_TRUNK)
        continue;
      pags_column_point(t, (double)c->height[at], stem);
      const double distance = pags_distance3(stem, (const double[3]){x, y, stem[2]});
      if (distance < nearest) {
        nearest = distance;
        c->owner[at] = i;
      }
    }
  }
}

typedef struct ranked {
  float height;
  int64_t at;
} ranked;

static int compare_heights(const void *left, const void *right) {
  const ranked *a = left, *b = right;
  return a->height > b->height ? -1 : a->height < b->height ? 1 : a->at < b->at ? -1 : a->at > b->at;
}

/* The distance between two cells, metres. */
static double distance(const canopy *c, int64_t a, int64_t b) {
  return cell * pags_hypot((double)(a % c->nx - b % c->nx), (double)(a / c->nx - b / c->nx));
}

/* Gives the other cells to peaks: from the highest cell down each joins what touches it, and so do two hills of which
 * one's peak is less than `prominence` above the cell. */
static pags_result grow_from_peaks(canopy *c, int64_t first) {
  const int64_t cells = c->nx * c->ny;
  PAGS_AUTOFREE ranked *list = malloc(((size_t)cells + 1) * sizeof *list);
  PAGS_AUTOFREE int64_t *peak = malloc(((size_t)cells + 1) * sizeof *peak); /* of the hill with this root */
  PAGS_AUTOFREE uint8_t *done = calloc((size_t)cells + 1, 1);
  PAGS_CHECK_MEMORY(list && peak && done, "%lld cells", (long long)cells);
  int64_t count = 0;
  for (int64_t i = 0; i < cells; i++)
    if (is_canopy(c, i) && c->owner[i] < 0)
      list[count++] = (ranked){c->height[i], i};
  pags_sort(list, count, sizeof *list, compare_heights);
  for (int64_t i = 0; i < count; i++) {
    const int64_t at = list[i].at;
    int64_t own = -1; /* root of the highest hill that touches it */
    done[at] = 1;
    peak[at] = at;
    for (int d = 0; d < 8; d++) {
      const int64_t other = neighbour(c, at, d);
      if (other < 0 || !done[other])
        continue;
      const int64_t root = pags_set_root(c->parent, other);
      if (distance(c, at, peak[root]) < widest_hill && (own < 0 || c->height[peak[root]] > c->height[peak[own]]))
        own = root;
    }
    if (own < 0)
      continue;
    for (int d = -1; d < 8; d++) {
      const int64_t other = d < 0 ? at : neighbour(c, at, d);
      if (other < 0 || !done[other])
        continue;
      const int64_t root = pags_set_root(c->parent, other), top = peak[own];
      if (root == own || (double)(c->height[peak[root]] - c->height[at]) >= prominence ||
          distance(c, peak[root], top) >= widest_hill)
        continue;
      pags_set_join(c->parent, root, own);
      own = pags_set_root(c->parent, own);
      peak[own] = top;
    }
  }
  /* Number the hills in the order of their first cells. */
  for (int64_t i = 0; i < cells; i++)
    if (done[i]) {
      const int64_t root = pags_set_root(c->parent, i); /* the smallest of its cells: it has its number already */
      c->owner[i] = root == i ? first + c->trees++ : c->owner[root];
    }
  return PAGS_OK;
}

/* ---- A tree ---- */

/* The vertices of one tree. */
typedef struct tree {
  const pags_proxy_mesh *joined;
  const float *heights;
  const int64_t *vertices;
  int64_t count, cells;
  pags_column trunk; /* found among the columns, or made up */
  bool found;
  double foot, top; /* of the crown above the ground */
} tree;

/* Finds where the crown begins: the lowest slice with enough vertices away from the trunk. */
static void find_foot(tree *t) {
  enum { SLICES = 80 };
  int64_t wide[SLICES] = {0}, widest = 0;
  for (int64_t i = 0; i < t->count; i++) {
    const double height = (double)t->heights[t->vertices[i]];
    const int s = (int)fmin(SLICES - 1, height / slice);
    double p[3], axis[3];
    pags_proxy_mesh_point(t->joined, t->vertices[i], p);
    pags_column_point(&t->trunk, height, axis);
    axis[2] = p[2];
    wide[s] += pags_distance3(p, axis) > around_trunk;
    widest = wide[s] > widest ? wide[s] : widest;
    t->top = fmax(t->top, height);
  }
  int s = 0;
  while (s < SLICES - 1 && (double)wide[s] < foot_share * (double)widest)
    s++;
  t->foot = s * slice;
}

/* The voxels of a crown: those with vertices, and those between two of them, one above the other. */
typedef struct crown {
  double lo[3];
  int64_t n[3];
  uint8_t *filled;
  int64_t count;
  float *points; /* of the filled voxels' middles, 3 each */
  int8_t *part;  /* the hull that each is of */
  int parts;
  double middle[PAGS_CROWN_HULLS][3];
} crown;

static void forget_crown(crown *c) {
  free(c->filled);
  free(c->points);
  free(c->part);
}

static bool in_crown(const tree *t, int64_t vertex) {
  return (double)t->heights[vertex] >= t->foot;
}

static pags_result fill_crown(const tree *t, crown *out) {
  double hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL}, p[3];
  int64_t voxels = 1;
  for (int k = 0; k < 3; k++)
    out->lo[k] = HUGE_VAL;
  for (int64_t i = 0; i < t->count; i++)
    if (in_crown(t, t->vertices[i])) {
      pags_proxy_mesh_point(t->joined, t->vertices[i], p);
      pags_box_add3(p, out->lo, hi);
    }
  for (int k = 0; k < 3; k++)
    voxels *= out->n[k] = (int64_t)((hi[k] - out->lo[k]) / voxel) + 1;
  out->filled = calloc((size_t)voxels, 1);
  PAGS_CHECK_MEMORY(out->filled, "a crown of %lld voxels", (long long)voxels);
  for (int64_t i = 0; i < t->count; i++)
    if (in_crown(t, t->vertices[i])) {
      int64_t at[3];
      pags_proxy_mesh_point(t->joined, t->vertices[i], p);
      for (int k = 0; k < 3; k++)
        at[k] = (int64_t)((p[k] - out->lo[k]) / voxel);
      out->filled[(at[1] * out->n[0] + at[0]) * out->n[2] + at[2]] = 1;
    }
  for (int64_t column = 0; column < out->n[0] * out->n[1]; column++) {
    uint8_t *f = out->filled + column * out->n[2];
    int64_t low = 0, high = out->n[2] - 1;
    while (low < high && !f[low])
      low++;
    while (high > low && !f[high])
      high--;
    for (int64_t z = low; z <= high; z++)
      out->count += f[z] = f[low];
  }
  out->points = malloc(((size_t)out->count + 1) * 3 * sizeof *out->points);
  out->part = calloc((size_t)out->count + 1, 1);
  PAGS_CHECK_MEMORY(out->points && out->part, "a crown of %lld voxels", (long long)out->count);
  int64_t count = 0;
  for (int64_t i = 0; i < voxels; i++)
    if (out->filled[i]) {
      const int64_t column = i / out->n[2], at[3] = {column % out->n[0], column / out->n[0], i % out->n[2]};
      for (int k = 0; k < 3; k++)
        out->points[3 * count + k] = (float)(out->lo[k] + ((double)at[k] + 0.5) * voxel);
      count++;
    }
  return PAGS_OK;
}

static int nearest_part(const crown *c, const double p[3]) {
  int best = 0;
  for (int i = 1; i < c->parts; i++)
    if (pags_distance_squared3(p, c->middle[i]) < pags_distance_squared3(p, c->middle[best]))
      best = i;
  return best;
}

/* Divides the crown: each first middle is the point farthest from those before it. */
static void divide_crown(crown *c) {
  const double volume = (double)c->count * voxel * voxel * voxel;
  const int most = (int)fmin(PAGS_CROWN_HULLS, 1 + floor(volume / hull_volume));
  double p[3], sum[PAGS_CROWN_HULLS][4];
  for (int round = 0; round < ROUNDS + most; round++) {
    double farthest = -1;
    int64_t far = 0;
    memset(sum, 0, sizeof sum);
    for (int64_t i = 0; i < c->count; i++) {
      pags_widen3(c->points + 3 * i, p);
      const int own = nearest_part(c, p);
      const double distance = c->parts ? pags_distance_squared3(p, c->middle[own]) : -p[2];
      pags_add3(sum[own], p, sum[own]);
      sum[own][3]++;
      if (!i || distance > farthest) {
        farthest = distance;
        far = i;
      }
    }
    if (round < most) {
      pags_widen3(c->points + 3 * far, c->middle[c->parts++]);
      continue;
    }
    for (int k = 0; k < c->parts; k++)
      for (int x = 0; x < 3 && sum[k][3] > 0; x++)
        c->middle[k][x] = sum[k][x] / sum[k][3];
  }
}

/* Moves a point towards the middle of the crown: leaves leave gaps, so that the eye and LiDAR see past the outermost.
 */
static void pull_in(const double middle[3], double p[3]) {
  const double length = pags_distance3(p, middle);
  for (int k = 0; k < 3; k++)
    p[k] -= (p[k] - middle[k]) * fmin(1, leaf_gap / fmax(length, leaf_gap));
}

/* Adds the hull of each part, of its vertices and voxels. */
static pags_result add_hulls(const tree *t, const crown *c, pags_proxy_mesh *mesh) {
  double middle[3] = {0};
  float at[3];
  for (int64_t i = 0; i < 3 * c->count; i++)
    middle[i % 3] += (double)c->points[i] / (double)c->count;
  for (int part = 0; part < c->parts; part++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh cloud = {0}, hull = {0};
    double p[3], color[3] = {0};
    for (int64_t i = 0; i < t->count; i++) {
      const int64_t v = t->vertices[i];
      pags_proxy_mesh_point(t->joined, v, p);
      if (!in_crown(t, v) || nearest_part(c, p) != part)
        continue;
      pull_in(middle, p);
      pags_narrow3(p, at);
      pags_proxy_mesh_vertex(&cloud, at, t->joined->colors + 3 * v, t->joined->observed[v]);
      for (int k = 0; k < 3; k++)
        color[k] += (double)t->joined->colors[3 * v + k];
    }
    const double count = fmax(1, (double)cloud.vertex_count);
    const float mean[3] = {(float)(color[0] / count), (float)(color[1] / count), (float)(color[2] / count)};
    for (int64_t i = 0; i < c->count; i++) {
      pags_widen3(c->points + 3 * i, p);
      if (nearest_part(c, p) != part)
        continue;
      pull_in(middle, p);
      pags_narrow3(p, at);
      pags_proxy_mesh_vertex(&cloud, at, mean, 0);
    }
    PAGS_TRY(pags_proxy_mesh_check(&cloud));
    const pags_result result = pags_proxy_mesh_hull(&cloud, HULL_TRIANGLES, &hull);
    if (result == PAGS_ERROR_ARGUMENT) /* all in a plane */
      continue;
    PAGS_TRY(result);
    PAGS_TRY(pags_proxy_mesh_append(&hull, mesh));
  }
  return PAGS_OK;
}

static pags_result make_tree(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground, tree *t) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
  PAGS_AUTO(forget_crown) crown c = {0};
  double middle[3] = {0}, p[3];
  if (!t->found) { /* below the middle of the crown */
    for (int64_t i = 0; i < t->count; i++) {
      pags_proxy_mesh_point(t->joined, t->vertices[i], p);
      for (int k = 0; k < 2; k++)
        middle[k] += p[k] / (double)t->count;
    }
    if (!pags_ground_nearest(ground, middle[0], middle[1], &middle[2]))
      return PAGS_OK;
    t->trunk = (pags_column){.radius = default_radius};
    pags_copy3(middle, t->trunk.foot);
  }
  if (t->count) {
    find_foot(t);
    PAGS_TRY(fill_crown(t, &c));
    divide_crown(&c);
  } else {
    t->foot = t->trunk.top - slice;
  }
  const bool is_tree = t->found || (t->top > least_tree && t->foot > clear_stem);
  if (is_tree) {
    pags_column_prism(&t->trunk, 8, -sink, t->foot + slice, t->found, &mesh);
    PAGS_TRY(pags_proxy_mesh_check(&mesh));
    PAGS_TRY(pags_proxy_mesh_paint(&mesh, &b->depth_views, 0.3, w->tasks));
  }
  PAGS_TRY(add_hulls(t, &c, &mesh));
  return mesh.triangle_count ? pags_background_add_solid(b, is_tree ? "tree" : "bush", &mesh) : PAGS_OK;
}

pags_result pags_trees_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                            pags_proxy_mesh *joined) {
  const pags_columns *columns = &b->columns;
  PAGS_AUTO(forget_canopy) canopy c = {0};
  if (!ground->nx)
    return PAGS_OK;
  PAGS_AUTOFREE float *heights = malloc(((size_t)joined->vertex_count + 1) * sizeof *heights);
  PAGS_CHECK_MEMORY(heights, "%lld vertices", (long long)joined->vertex_count);
  PAGS_TRY(make_canopy(ground, joined, heights, &c));
  grow_from_trunks(&c, b);
  PAGS_TRY(grow_from_peaks(&c, columns->count));

  /* Group the vertices by tree: a counting sort. */
  const int64_t trees = columns->count + c.trees;
  PAGS_AUTOFREE int64_t *first = calloc((size_t)trees + 2, sizeof *first);
  PAGS_AUTOFREE int64_t *cells = calloc((size_t)trees + 1, sizeof *cells);
  PAGS_AUTOFREE int64_t *vertices = malloc(((size_t)joined->vertex_count + 1) * sizeof *vertices);
  PAGS_CHECK_MEMORY(first && cells && vertices, "%lld trees", (long long)trees);
  for (int64_t i = 0; i < c.nx * c.ny; i++)
    if (c.owner[i] >= 0)
      cells[c.owner[i]]++;
  for (int pass = 0; pass < 2; pass++) {
    for (int64_t i = 0; i < joined->vertex_count; i++) {
      double p[3];
      pags_proxy_mesh_point(joined, i, p);
      const int64_t owner = heights[i] < 0 ? -1 : c.owner[cell_of(&c, p)];
      if (owner >= 0 && pass)
        vertices[first[owner + 1]++] = i;
      else if (owner >= 0)
        first[owner + 2]++;
    }
    for (int64_t i = 0; i < trees && !pass; i++)
      first[i + 2] += first[i + 1];
  }
  for (int64_t i = 0; i < trees; i++) {
    tree t = {.joined = joined,
              .heights = heights,
              .vertices = vertices + first[i],
              .count = first[i + 1] - first[i],
              .cells = cells[i],
              .found = i < columns->count};
    if (t.found)
      t.trunk = columns->list[i];
    if (t.cells < LEAST_CELLS)
      t.count = 0;
    if (t.count || (t.found && pags_column_kind_of(&t.trunk, b->labelled) == PAGS_COLUMN_TRUNK))
      PAGS_TRY(make_tree(w, b, ground, &t));
  }
  return PAGS_OK;
}
