/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of fences: pixels that the semantic pictures label so are counted in cells of a lattice in x and
 * y; cells that touch become one fence of upright boxes, each along the principal axis of its cells. A box whose cells
 * don't lie along it is cut in two. */
#include "exporters/proxy/background.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/tsdf.h"
#include "maths/maths.h"

enum {
  LEAST_PIXELS = 6, /* of a cell */
  LEAST_CELLS = 6,  /* of a fence */
  REACH = 2,        /* cells up to which two touch */
  CUTS = 2          /* of a box, one after another: at most four boxes */
};

/* In metres. */
static const double cell = 0.25, farthest = 30;      /* side of a cell; largest depth of pixels */
static const double lowest = 0.2, highest = 4;       /* heights above the ground */
static const double most_off = 0.25, hopeless = 0.6; /* distance of cells from a box's axis: it is cut; left out */
static const double thickness = 0.1, sink = 0.03;
static const double least_length = 0.8;

typedef struct post {
  double p[3], height; /* a cell's mean point; its highest point above the ground */
  double along;
} post;

/* The lattice: for each cell the sum of the points, their number and the highest above the ground. */
typedef struct lattice {
  double x0, y0;
  int64_t nx, ny;
  double (*sum)[5];
  int64_t *parent;
} lattice;

static void forget_lattice(lattice *l) {
  free(l->sum);
  free(l->parent);
}

/* Adds a view's pixels of fences. */
static void add_view(const pags_depth_view *s, const pags_ground *ground, lattice *l) {
  for (int y = 0; y < s->camera.height; y++)
    for (int x = 0; x < s->camera.width; x++) {
      const int64_t at = (int64_t)y * s->camera.width + x;
      const double depth = (double)s->depth[at];
      double p[3], z;
      if (s->labels[at] != PAGS_LABEL_FENCE || !(depth > 0 && depth < farthest))
        continue;
      pags_depth_view_point(s, x, y, depth, p);
      const double i = floor((p[0] - l->x0) / cell), j = floor((p[1] - l->y0) / cell);
      if (!(i >= 0 && j >= 0 && i < (double)l->nx && j < (double)l->ny) ||
          !pags_ground_nearest(ground, p[0], p[1], &z) || p[2] - z < lowest || p[2] - z > highest)
        continue;
      double *own = l->sum[(int64_t)j * l->nx + (int64_t)i];
      pags_add3(own, p, own);
      own[3]++;
      own[4] = fmax(own[4], p[2] - z);
    }
}

static bool is_fence(const lattice *l, int64_t at) {
  return l->sum[at][3] >= LEAST_PIXELS;
}

/* Joins cells that are at most REACH from each other. */
static void join_cells(lattice *l) {
  for (int64_t y = 0; y < l->ny; y++)
    for (int64_t x = 0; x < l->nx; x++)
      for (int64_t v = y; v <= y + REACH && v < l->ny && is_fence(l, y * l->nx + x); v++)
        for (int64_t u = x < REACH ? 0 : x - REACH; u <= x + REACH && u < l->nx; u++)
          if (is_fence(l, v * l->nx + u))
            pags_set_join(l->parent, y * l->nx + x, v * l->nx + u);
}

static int compare_posts(const void *left, const void *right) {
  const post *a = left, *b = right;
  return (a->along > b->along) - (a->along < b->along);
}

/* Adds the box of some posts, or after a cut those of both halves. */
static void add_boxes(const pags_ground *ground, post *posts, int64_t count, int cuts, pags_proxy_mesh *mesh) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  double mean[2] = {0}, xx = 0, xy = 0, yy = 0, off = 0, height = 0, rings[2][4][3];
  if (count < LEAST_CELLS / 2)
    return;
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 2; k++)
      mean[k] += posts[i].p[k] / (double)count;
  for (int64_t i = 0; i < count; i++) {
    const double x = posts[i].p[0] - mean[0], y = posts[i].p[1] - mean[1];
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  const double angle = 0.5 * pags_atan2(2 * xy, xx - yy), u[2] = {pags_cos(angle), pags_sin(angle)};
  for (int64_t i = 0; i < count; i++) {
    const double x = posts[i].p[0] - mean[0], y = posts[i].p[1] - mean[1];
    posts[i].along = x * u[0] + y * u[1];
    off = fmax(off, fabs(y * u[0] - x * u[1]));
    height += posts[i].height / (double)count;
  }
  pags_sort(posts, count, sizeof *posts, compare_posts);
  if (off > most_off && cuts) {
    add_boxes(ground, posts, count / 2, cuts - 1, mesh);
    add_boxes(ground, posts + count / 2, count - count / 2, cuts - 1, mesh);
    return;
  }
  const double ends[2] = {posts[0].along - 0.5 * cell, posts[count - 1].along + 0.5 * cell};
  if (off > hopeless || ends[1] - ends[0] < least_length)
    return;
  for (int r = 0; r < 2; r++) {
    const double at[2] = {mean[0] + ends[r] * u[0], mean[1] + ends[r] * u[1]};
    double z;
    if (!pags_ground_nearest(ground, at[0], at[1], &z))
      return;
    for (int i = 0; i < 4; i++) { /* counter-clockwise about the box's axis: right, left, then above these */
      const double side = (i == 1 || i == 2 ? 0.5 : -0.5) * thickness;
      const double corner[3] = {at[0] - side * u[1], at[1] + side * u[0], i < 2 ? z - sink : z + height};
      pags_copy3(corner, rings[r][i]);
    }
  }
  pags_proxy_mesh_prism(mesh, 4, rings[0], rings[1], grey, (const bool[2]){true, true});
}

pags_result pags_fences_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground) {
  PAGS_AUTO(forget_lattice)
  lattice l = {.x0 = ground->x0,
               .y0 = ground->y0,
               .nx = (int64_t)((ground->nx - 1) * ground->step / cell) + 1,
               .ny = (int64_t)((ground->ny - 1) * ground->step / cell) + 1};
  const int64_t cells = l.nx * l.ny;
  if (!b->labelled || !ground->nx)
    return PAGS_OK;
  PAGS_AUTOFREE post *posts = malloc(((size_t)cells + 1) * sizeof *posts);
  PAGS_AUTOFREE int64_t *next = calloc((size_t)cells + 2, sizeof *next);
  l.sum = calloc((size_t)cells + 1, sizeof *l.sum);
  l.parent = malloc(((size_t)cells + 1) * sizeof *l.parent);
  PAGS_CHECK_MEMORY(l.sum && l.parent && posts && next, "%lld cells", (long long)cells);
  for (int64_t i = 0; i < cells; i++)
    l.parent[i] = i;
  for (int64_t i = 0; i < b->depth_views.count; i++)
    if (b->depth_views.list[i].labels)
      add_view(&b->depth_views.list[i], ground, &l);
  join_cells(&l);

  /* Group the cells by fence: a counting sort by the fence's first cell. */
  for (int64_t i = 0; i < cells; i++)
    if (is_fence(&l, i))
      next[pags_set_root(l.parent, i) + 2]++;
  for (int64_t i = 0; i < cells; i++)
    next[i + 2] += next[i + 1];
  for (int64_t i = 0; i < cells; i++)
    if (is_fence(&l, i)) {
      post *own = &posts[next[pags_set_root(l.parent, i) + 1]++];
      *own = (post){.height = l.sum[i][4]};
      for (int k = 0; k < 3; k++)
        own->p[k] = l.sum[i][k] / l.sum[i][3];
    }
  for (int64_t i = 0; i < cells; i++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
    if (next[i + 1] - next[i] < LEAST_CELLS)
      continue;
    add_boxes(ground, posts + next[i], next[i + 1] - next[i], CUTS, &mesh);
    if (!mesh.triangle_count)
      continue;
    PAGS_TRY(pags_proxy_mesh_check(&mesh));
    PAGS_TRY(pags_proxy_mesh_paint(&mesh, &b->depth_views, 0.3, w->tasks));
    PAGS_TRY(pags_background_add_solid(b, "fence", &mesh));
  }
  return PAGS_OK;
}
