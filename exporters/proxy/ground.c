/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the ground as a height field and makes its mesh.
 *
 * Each cell of a lattice collects heights from LiDAR points and from pixels that form a level plane with their
 * neighbours. From below the cameras, where the ground must be, the ground grows from cell to cell: the height of a
 * cell is the median of its heights near the height that its neighbours predict, so that tables, roofs and
 * reflections are left out and a kerb is followed. Heights are taken from LiDAR if a cell has enough of them, else
 * from near pixels, else from far pixels. */
#include "exporters/proxy/ground.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"

static const double cell = 0.2; /* distance of lattice points, metres */

/* Depths in metres: pixels farther than `farthest` see the ground at too flat an angle to tell its height; those
 * nearer than `nearer` tell it well. */
static const double farthest = 45, nearer = 10;

/* The low-pass filter of drawing widens Gaussians of the ground upwards: pixels where it does by more than this are
 * not used, metres. */
static const double most_blur = 0.03;

/* Most difference, in metres, of a height from the expected height: for the first cells, and for growing. The latter
 * is more than a kerb's height and less than a low wall's. */
static const double seed_band = 0.3, grow_band = 0.18;

/* The same for heights of pixels if there is LiDAR, which measures kerbs better: pixels only continue its surface. */
static const double lidar_band = 0.06;
static const double upright = 2; /* height above the ground up to which upright things are looked for, metres */

/* Least number of heights of a cell; number from which near pixels are enough; half widths in cells of the windows in
 * which known neighbours are looked for: next to a cell, and across the gap between two LiDAR rings. */
enum { LEAST_HEIGHTS = 3, ENOUGH_HEIGHTS = 8, WINDOW = 2, LEAP = 15 };

/* ---- Collecting heights ---- */

/* The heights of all cells from one source: LiDAR, near pixels, or all pixels. */
typedef struct heights {
  int64_t *first;             /* index of each cell's first value; cells + 1 entries */
  float *values;              /* grouped by cell, ascending in a cell */
  int enough;                 /* number of heights of a cell that makes other sources unnecessary */
  double most_band;           /* most difference from the expected height, metres */
  const struct heights *next; /* the source to ask if there are not enough; NULL: none */
} heights;

/* The three sources, and what looking for the ground allocates besides. */
typedef struct search {
  heights sources[3];
  int64_t *queue; /* of cells */
  float *weights; /* of cells, for smoothing */
} search;

static void forget_search(search *s) {
  for (int i = 0; i < 3; i++) {
    free(s->sources[i].first);
    free(s->sources[i].values);
  }
  free(s->queue);
  free(s->weights);
}

/* Where heights are collected from. */
typedef struct source {
  const pags_depth_views *depth_views; /* NULL: the source is LiDAR */
  const pags_lidar *lidar;
  double reach; /* largest depth of pixels, metres */
} source;

void pags_ground_destroy(pags_ground *ground) {
  free(ground->z);
  free(ground->known);
  free(ground->nearest);
  *ground = (pags_ground){0};
}

/* The point of a pixel, if it forms a level plane with the pixels to the right and below; returns false if it doesn't.
 * The point is taken from the plane of a flat Gaussian if the view has one. */
static bool level_point(const pags_depth_view *s, int x, int y, double reach, double p[3]) {
  const int64_t at = (int64_t)y * s->camera.width + x;
  double n[3];
  if (!(s->depth[at] > 0) || (double)s->depth[at] > reach)
    return false;
  pags_depth_view_point(s, x, y, (double)s->depth[at], p);
  if (!pags_depth_view_normal(s, x, y, x + 1, y + 1, p, n))
    return false;
  if (s->plane && s->plane[at] > 0)
    pags_depth_view_point(s, x, y, (double)s->plane[at], p);
  return fabs(n[2]) > 0.85 * pags_length3(n);
}

/* Counts a height of a cell, or stores it if `values` is given. */
static void note_height(int64_t at, float height, int64_t *count, float *values) {
  if (at >= 0 && values)
    values[count[at]++] = height;
  else if (at >= 0)
    ++count[at + 1];
}

/* Visits all points of LiDAR or all pixels of the views, without `values` to count the heights of each cell, with it to
 * store them. */
static void visit(const pags_ground *g, const source *from, int64_t *count, float *values) {
  for (int64_t i = 0; !from->depth_views && i < from->lidar->count; i++) {
    const float *p = from->lidar->points + 3 * i;
    note_height(pags_ground_cell(g, (double)p[0], (double)p[1]), p[2], count, values);
  }
  for (int64_t i = 0; from->depth_views && i < from->depth_views->count; i++) {
    const pags_depth_view *s = &from->depth_views->list[i];
    double reach = s->blur > 0 ? fmin(from->reach, most_blur * s->camera.fx / s->blur) : from->reach;
    for (int y = 0; y + 1 < s->camera.height; y++)
      for (int x = 0; x + 1 < s->camera.width; x++) {
        double p[3];
        if (level_point(s, x, y, reach, p))
          note_height(pags_ground_cell(g, p[0], p[1]), (float)p[2], count, values);
      }
  }
}

/* Collects the heights of one source by a counting sort into cells, then sorts each cell's. */
static pags_result gather_heights(const pags_ground *g, const source *from, heights *out) {
  const int64_t cells = (int64_t)g->nx * g->ny;
  PAGS_AUTOFREE int64_t *next = calloc((size_t)cells + 1, sizeof *next);
  out->first = calloc((size_t)cells + 2, sizeof *out->first);
  if (next && out->first) {
    visit(g, from, out->first, NULL);
    for (int64_t i = 0; i < cells; i++)
      out->first[i + 1] += out->first[i];
    memcpy(next, out->first, (size_t)cells * sizeof *next);
    out->values = malloc(((size_t)out->first[cells] + 1) * sizeof *out->values);
  }
  PAGS_CHECK_MEMORY(out->values, "the ground's %lld cells", (long long)cells);
  visit(g, from, next, out->values);
  for (int64_t i = 0; i < cells; i++)
    pags_sort_floats(out->values + out->first[i], out->first[i + 1] - out->first[i]);
  return PAGS_OK;
}

/* ---- Growing ---- */

/* The median of a cell's heights within `band` of `expected`, from the first source that has enough of them. Returns
 * how many there are. */
static int64_t median_near(const heights *h, int64_t at, double expected, double band, double *median) {
  for (;; h = h->next) {
    int64_t begin = h->first[at], end = h->first[at + 1];
    double reach = fmin(band, h->most_band);
    while (begin < end && (double)h->values[begin] < expected - reach)
      begin++;
    while (end > begin && (double)h->values[end - 1] > expected + reach)
      end--;
    if (end - begin < h->enough && h->next)
      continue;
    if (end > begin)
      *median = 0.5 * ((double)h->values[begin + (end - begin - 1) / 2] + (double)h->values[begin + (end - begin) / 2]);
    return end - begin;
  }
}

/* The height of the cameras above the ground: the median, over the cells within 4 m of a camera, of the camera's
 * height above the lower quartile of the cell's heights. NaN if no cell there has heights. */
static double camera_height(const pags_ground *g, const heights *h, const double *path, int64_t path_count) {
  int64_t found = 0;
  PAGS_AUTOFREE double *list = malloc((size_t)path_count * 1681 * sizeof *list);
  for (int64_t i = 0; list && i < path_count; i++)
    for (int dy = -20; dy <= 20; dy++)
      for (int dx = -20; dx <= 20; dx++) {
        int64_t at = pags_ground_cell(g, path[3 * i] + dx * g->step, path[3 * i + 1] + dy * g->step);
        if (at < 0 || h->first[at + 1] - h->first[at] < LEAST_HEIGHTS)
          continue;
        double height = path[3 * i + 2] - (double)h->values[h->first[at] + (h->first[at + 1] - h->first[at]) / 4];
        if (height > 0.4 && height < 5)
          list[found++] = height;
      }
  if (!found)
    return (double)NAN;
  pags_sort_doubles(list, found);
  return list[found / 2];
}

/* Finds the first cells of the ground within 3 m of the cameras, near the expected height, and queues them. Returns
 * how many. */
static int64_t plant(pags_ground *g, const heights *h, const double *path, int64_t path_count, double height,
                     int64_t *queue) {
  int64_t count = 0;
  for (int64_t i = 0; i < path_count; i++)
    for (int dy = -15; dy <= 15; dy++)
      for (int dx = -15; dx <= 15; dx++) {
        int64_t at = pags_ground_cell(g, path[3 * i] + dx * g->step, path[3 * i + 1] + dy * g->step);
        double z = 0;
        if (at < 0 || g->known[at] || median_near(h, at, path[3 * i + 2] - height, seed_band, &z) < LEAST_HEIGHTS)
          continue;
        g->known[at] = 1;
        g->z[at] = (float)z;
        queue[count++] = at;
      }
  return count;
}

/* The mean height of the known cells at most `window` cells away in x and y. Returns how many there are. */
static int around(const pags_ground *g, int64_t x, int64_t y, int window, double *mean) {
  double sum = 0;
  int count = 0;
  for (int64_t j = y - window; j <= y + window; j++)
    for (int64_t i = x - window; i <= x + window; i++)
      if (i >= 0 && j >= 0 && i < g->nx && j < g->ny && g->known[j * g->nx + i]) {
        sum += (double)g->z[j * g->nx + i];
        count++;
      }
  *mean = count ? sum / count : 0;
  return count;
}

/* Whether LiDAR hit something upright in a cell: the foot of a wall, whose heights the ground would climb. */
static bool is_foot(const heights *lidar, int64_t at, double expected) {
  int64_t level = 0, above = 0;
  for (int64_t i = lidar->first[at]; i < lidar->first[at + 1]; i++) {
    double over = (double)lidar->values[i] - expected;
    level += fabs(over) <= grow_band;
    above += over > grow_band && over < upright;
  }
  return above >= LEAST_HEIGHTS && above > level / 2;
}

/* Grows the ground from the queued cells to their neighbours, breadth first. */
static void grow(pags_ground *g, const heights *h, int64_t *queue, int64_t count) {
  static const int dx[4] = {1, -1, 0, 0}, dy[4] = {0, 0, 1, -1};
  for (int64_t head = 0; head < count; head++)
    for (int d = 0; d < 4; d++) {
      int64_t x = queue[head] % g->nx + dx[d], y = queue[head] / g->nx + dy[d];
      double expected, z = 0;
      if (x < 0 || y < 0 || x >= g->nx || y >= g->ny || g->known[y * g->nx + x])
        continue;
      around(g, x, y, WINDOW, &expected);
      if (is_foot(h, y * g->nx + x, expected) || median_near(h, y * g->nx + x, expected, grow_band, &z) < LEAST_HEIGHTS)
        continue;
      g->known[y * g->nx + x] = 1;
      g->z[y * g->nx + x] = (float)z;
      queue[count++] = y * g->nx + x;
    }
}

/* Continues growing across gaps: where LiDAR rings are sparse and no pixel shows the ground between them, cells
 * with LiDAR heights up to LEAP cells from known ground are added, and the ground grows on from there. */
static void leap(pags_ground *g, const heights *h, int64_t *queue) {
  heights lidar = *h;
  lidar.next = NULL;
  for (int64_t count = 1; count > 0; grow(g, h, queue, count)) {
    count = 0;
    for (int64_t at = 0; at < (int64_t)g->nx * g->ny; at++) {
      double expected, z;
      if (g->known[at] || lidar.first[at + 1] - lidar.first[at] < LEAST_HEIGHTS ||
          !around(g, at % g->nx, at / g->nx, LEAP, &expected) || is_foot(&lidar, at, expected) ||
          median_near(&lidar, at, expected, grow_band, &z) < LEAST_HEIGHTS)
        continue;
      g->z[at] = (float)z;
      queue[count++] = at;
    }
    for (int64_t i = 0; i < count; i++)
      g->known[queue[i]] = 1;
  }
}

/* ---- Finding the ground ---- */

pags_result pags_ground_find(const pags_depth_views *depth_views, const pags_lidar *lidar, const double *path,
                             int64_t path_count, double reach, double margin, pags_ground *out) {
  const source from[3] = {
      {.lidar = lidar}, {.depth_views = depth_views, .reach = nearer}, {.depth_views = depth_views, .reach = farthest}};
  static const int enough[3] = {LEAST_HEIGHTS, ENOUGH_HEIGHTS, LEAST_HEIGHTS};
  double lo[2] = {HUGE_VAL, HUGE_VAL}, hi[2] = {-HUGE_VAL, -HUGE_VAL};
  *out = (pags_ground){.step = cell};
  for (int64_t i = 0; i < path_count; i++)
    for (int k = 0; k < 2; k++) {
      lo[k] = fmin(lo[k], path[3 * i + k] - margin);
      hi[k] = fmax(hi[k], path[3 * i + k] + margin);
    }
  if (!path_count)
    return PAGS_OK;
  double nx = ceil((hi[0] - lo[0]) / cell) + 1, ny = ceil((hi[1] - lo[1]) / cell) + 1;
  if (!(nx * ny < 1e8))
    return pags_fail(PAGS_ERROR_LIMIT, "the path of the cameras spans %g x %g m: too much for one ground",
                     hi[0] - lo[0], hi[1] - lo[1]);
  const int64_t cells = (int64_t)(nx * ny);
  *out = (pags_ground){.nx = (int)nx,
                       .ny = (int)ny,
                       .x0 = lo[0],
                       .y0 = lo[1],
                       .step = cell,
                       .z = calloc((size_t)cells, sizeof *out->z),
                       .known = calloc((size_t)cells, 1)};
  PAGS_CHECK_MEMORY(out->z && out->known, "the ground");

  PAGS_AUTO(forget_search) search s = {0};
  heights *const sources = s.sources;
  for (int i = 0; i < 3; i++) {
    PAGS_TRY(gather_heights(out, &from[i], &sources[i]));
    sources[i].enough = enough[i];
    sources[i].next = i < 2 ? &sources[i + 1] : NULL;
    sources[i].most_band = i > 0 && lidar->count ? lidar_band : HUGE_VAL;
  }
  const double height = camera_height(out, &sources[2], path, path_count);
  s.queue = malloc(((size_t)cells + 1) * sizeof *s.queue);
  s.weights = malloc(((size_t)cells + 1) * sizeof *s.weights);
  PAGS_CHECK_MEMORY(s.queue && s.weights, "the ground's %lld cells", (long long)cells);
  const int64_t planted = isnan(height) ? 0 : plant(out, sources, path, path_count, height, s.queue);
  grow(out, sources, s.queue, planted);
  leap(out, sources, s.queue);
  if (!planted) {
    pags_ground_destroy(out);
    return PAGS_OK;
  }

  /* The weights of cells: each LiDAR height counts 1; the height of a pixel counts 0.004 if there is LiDAR, since
   * pixels blur kerbs, else 0.5. */
  const double of_pixel = sources[0].first[cells] ? 0.004 : 0.5;
  for (int64_t i = 0; i < cells; i++) {
    const double by_lidar = (double)(sources[0].first[i + 1] - sources[0].first[i]),
                 count = (double)(sources[2].first[i + 1] - sources[2].first[i]);
    s.weights[i] = (float)(by_lidar >= sources[0].enough ? fmin(by_lidar, 40) : fmin(count, 24) * of_pixel);
  }
  PAGS_TRY(pags_ground_see(depth_views, s.queue, out));
  return pags_ground_fill(out, s.weights, path, path_count, reach);
}

bool pags_ground_height(const pags_ground *ground, double x, double y, double *z) {
  double u = (x - ground->x0) / ground->step, v = (y - ground->y0) / ground->step, sum = 0;
  double i = floor(u), j = floor(v);
  if (!ground->nx || !(i >= 0 && j >= 0 && i + 1 < ground->nx && j + 1 < ground->ny))
    return false;
  for (int c = 0; c < 4; c++) {
    int64_t at = ((int64_t)j + (c >> 1)) * ground->nx + (int64_t)i + (c & 1);
    if (!ground->known[at])
      return false;
    sum += (double)ground->z[at] * (c & 1 ? u - i : 1 - u + i) * (c >> 1 ? v - j : 1 - v + j);
  }
  *z = sum;
  return true;
}

bool pags_ground_nearest(const pags_ground *g, double x, double y, double *z) {
  if (!g->nearest)
    return false;
  const int64_t at = pags_ground_cell(g, fmin(fmax(x, g->x0), g->x0 + (g->nx - 1) * g->step),
                                      fmin(fmax(y, g->y0), g->y0 + (g->ny - 1) * g->step));
  *z = (double)g->nearest[at];
  return true;
}

/* ---- The mesh ---- */

/* Meshes every `stride`th lattice point in x and y: two triangles wherever all four corners are ground. */
static pags_result mesh_lattice(const pags_ground *g, int stride, pags_proxy_mesh *out) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  int nx = (g->nx - 1) / stride + 1, ny = (g->ny - 1) / stride + 1;
  PAGS_AUTOFREE uint32_t *place = malloc((size_t)nx * (size_t)ny * sizeof *place);
  *out = (pags_proxy_mesh){0};
  PAGS_CHECK_MEMORY(place, "the ground");
  for (int j = 0; j < ny; j++)
    for (int i = 0; i < nx; i++) {
      int64_t at = (int64_t)j * stride * g->nx + (int64_t)i * stride;
      const float p[3] = {(float)(g->x0 + i * stride * g->step), (float)(g->y0 + j * stride * g->step), g->z[at]};
      place[(size_t)j * (size_t)nx + (size_t)i] =
          g->known[at] ? pags_proxy_mesh_vertex(out, p, grey, g->known[at] == 1) : UINT32_MAX;
    }
  for (int j = 0; j + 1 < ny; j++)
    for (int i = 0; i + 1 < nx; i++) {
      const uint32_t *row = place + (size_t)j * (size_t)nx + (size_t)i;
      uint32_t a = row[0], b = row[1], c = row[nx + 1], d = row[nx];
      if (a == UINT32_MAX || b == UINT32_MAX || c == UINT32_MAX || d == UINT32_MAX)
        continue;
      pags_proxy_mesh_triangle(out, a, b, c);
      pags_proxy_mesh_triangle(out, a, c, d);
    }
  PAGS_TRY(pags_proxy_mesh_check(out));
  return pags_proxy_mesh_compact(out);
}

/* Whether all triangles have the same orientation as seen from above, so that the mesh doesn't fold over itself. */
static bool single_valued(const pags_proxy_mesh *s) {
  double n[3];
  for (int64_t i = 0; i < s->triangle_count; i++) {
    pags_proxy_mesh_cross(s, i, n);
    if (!(n[2] > 0))
      return false;
  }
  return true;
}

pags_result pags_ground_mesh(const pags_ground *ground, int64_t budget, pags_proxy_mesh *out) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh full = {0};
  *out = (pags_proxy_mesh){0};
  PAGS_TRY(mesh_lattice(ground, 1, &full));

  /* Move the vertices by up to a millimetre in x and y: with collinear vertices, edge collapses would make triangles
   * of no area, which can turn over unnoticed. */
  uint32_t state = 1;
  for (int64_t i = 0; i < 3 * full.vertex_count; i++) {
    state = state * 1664525u + 1013904223u; /* Numerical Recipes' generator */
    if (i % 3 < 2)
      full.positions[i] += 0.002f * ((float)(state >> 8) / 16777216.0f - 0.5f);
  }
  if (pags_proxy_mesh_simplify(&full, budget, out) == PAGS_OK && single_valued(out))
    return PAGS_OK;
  /* The decimated mesh folds over: take every second lattice point instead, every third, and so on, until it fits. */
  for (int stride = 2;; stride++) {
    pags_proxy_mesh_destroy(out);
    PAGS_TRY(mesh_lattice(ground, stride, out));
    if (out->triangle_count <= budget)
      return PAGS_OK;
  }
}
