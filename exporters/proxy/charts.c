/* SPDX-License-Identifier: Apache-2.0 */
/* Cuts a mesh into charts for a texture. The largest triangle without a chart is the seed of the next one, which grows
 * over triangles that touch it, face the seed's way and keep the picture small. It is projected along the seed's normal
 * into the smallest rectangle. A triangle that would show on a texel of an earlier one is left for another chart, so
 * each texel shows one place. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/texture.h"
#include "maths/maths.h"

enum {
  UNIT = 16,          /* steps a pixel in which corners are placed, so that edges are exact */
  MOST_SIDE = 512,    /* a chart stops growing at this many pixels, unless a single triangle is larger */
  MOST_PIXELS = 2048, /* most pixels a side */
  ANGLES = 16         /* turns of the rectangle that are tried */
};

static const double least_cosine = 0.7; /* between the normals of a chart's seed and its other triangles */

/* A triangle and its area, to begin with the largest. */
typedef struct seed {
  double area;
  int64_t triangle;
} seed;

static int compare_seeds(const void *left, const void *right) {
  const seed *a = left, *b = right;
  if (a->area != b->area)
    return a->area > b->area ? -1 : 1;
  return a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

typedef struct cutting {
  const pags_proxy_mesh *mesh;
  const float *need;
  double scale;            /* of `need`, for a limit of texels */
  double (*normals)[3];    /* of each triangle, unit length; zero where it has no area */
  double *areas;           /* of each triangle, square metres */
  int64_t *first, *around; /* around[first[v]] to around[first[v + 1] - 1] are the triangles at vertex v */
  int64_t *members, count; /* triangles of the chart that grows, in the order in which they came */
  int32_t *owners;         /* of all texels */
  int64_t owner_capacity;
  pags_texture *out;
} cutting;

static void forget_cutting(cutting *c) {
  free(c->normals);
  free(c->areas);
  free(c->first);
  free(c->around);
  free(c->members);
  free(c->owners);
}

/* ---- Growing a chart ---- */

/* Two axes at right angles to `n` and to each other. */
static void axes_of(const double n[3], double axes[2][3]) {
  double unit[3] = {0};
  int smallest = 0;
  for (int k = 1; k < 3; k++)
    smallest = fabs(n[k]) < fabs(n[smallest]) ? k : smallest;
  unit[smallest] = 1;
  pags_cross3(unit, n, axes[0]);
  const double length = pags_length3(axes[0]);
  pags_divide3(axes[0], length > 0 ? length : 1);
  pags_cross3(n, axes[0], axes[1]);
}

/* Extends a rectangle by a triangle's corners. */
static void extend(const cutting *c, int64_t triangle, const double axes[2][3], double lo[2], double hi[2]) {
  double p[3][3];
  pags_proxy_mesh_corners(c->mesh, triangle, p);
  for (int k = 0; k < 6; k++) {
    const double at = pags_dot3(p[k / 2], axes[k % 2]);
    lo[k % 2] = fmin(lo[k % 2], at);
    hi[k % 2] = fmax(hi[k % 2], at);
  }
}

static void grow(cutting *c, int64_t begin, int32_t chart, const double axes[2][3]) {
  const double *n = c->normals[begin];
  double lo[2] = {HUGE_VAL, HUGE_VAL}, hi[2] = {-HUGE_VAL, -HUGE_VAL};
  extend(c, begin, axes, lo, hi);
  const double limit = fmax(MOST_SIDE / (c->scale * (double)c->need[begin]), fmax(hi[0] - lo[0], hi[1] - lo[1]));
  c->count = 0;
  c->members[c->count++] = begin;
  c->out->chart_of[begin] = chart;
  for (int64_t at = 0; at < c->count; at++)
    for (int k = 0; k < 3; k++) {
      const uint32_t vertex = c->mesh->triangles[3 * c->members[at] + k];
      for (int64_t i = c->first[vertex]; i < c->first[vertex + 1]; i++) {
        const int64_t t = c->around[i];
        if (c->out->chart_of[t] >= 0 || pags_dot3(c->normals[t], n) < least_cosine)
          continue;
        double low[2] = {lo[0], lo[1]}, high[2] = {hi[0], hi[1]};
        extend(c, t, axes, low, high);
        if (high[0] - low[0] > limit || high[1] - low[1] > limit)
          continue;
        memcpy(lo, low, sizeof low);
        memcpy(hi, high, sizeof high);
        c->out->chart_of[t] = chart;
        c->members[c->count++] = t;
      }
    }
}

/* ---- Placing it ---- */

/* Turns the axes so that the members' rectangle is smallest, and wider than high; `lo` and `size` receive it. */
static void turn(const cutting *c, double axes[2][3], double lo[2], double size[2]) {
  double best = HUGE_VAL, found[2][3] = {{0}};
  for (int i = 0; i < 2 * ANGLES; i++) {
    const double angle = 1.5707963267948966 * i / ANGLES, cosine = pags_cos(angle), sine = pags_sin(angle);
    double turned[2][3], low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
    for (int k = 0; k < 3; k++) {
      turned[0][k] = cosine * axes[0][k] + sine * axes[1][k];
      turned[1][k] = cosine * axes[1][k] - sine * axes[0][k];
    }
    for (int64_t m = 0; m < c->count; m++)
      extend(c, c->members[m], (const double(*)[3])turned, low, high);
    const double area = (high[0] - low[0]) * (high[1] - low[1]);
    if (!(area < best) || high[0] - low[0] < high[1] - low[1])
      continue;
    best = area;
    memcpy(found, turned, sizeof found);
    for (int k = 0; k < 2; k++) {
      lo[k] = low[k];
      size[k] = high[k] - low[k];
    }
  }
  memcpy(axes, found, sizeof found);
}

/* Whether a point is to the left of the edge from a to b. A point on the edge is so for one of its two directions. */
static bool is_left(const int64_t a[2], const int64_t b[2], int64_t x, int64_t y) {
  const int64_t dx = b[0] - a[0], dy = b[1] - a[1], side = dx * (y - a[1]) - dy * (x - a[0]);
  return side > 0 || (side == 0 && (dy > 0 || (dy == 0 && dx < 0)));
}

/* Visits the texels whose middle is in the triangle. With `claim` they become the triangle's; returns whether another
 * has one of them. */
static bool cover(const int64_t p[3][2], const pags_chart *chart, int32_t *owners, int32_t triangle, bool claim) {
  int64_t lo[2], hi[2];
  for (int k = 0; k < 2; k++) {
    const int64_t least = p[0][k] < p[1][k] ? p[0][k] : p[1][k], most = p[0][k] > p[1][k] ? p[0][k] : p[1][k];
    lo[k] = (least < p[2][k] ? least : p[2][k]) / UNIT;
    hi[k] = (most > p[2][k] ? most : p[2][k]) / UNIT;
  }
  for (int64_t y = lo[1]; y <= hi[1]; y++)
    for (int64_t x = lo[0]; x <= hi[0]; x++) {
      const int64_t u = UNIT * x + UNIT / 2, v = UNIT * y + UNIT / 2;
      int32_t *owner = &owners[chart->texel + y * chart->width + x];
      if (!is_left(p[0], p[1], u, v) || !is_left(p[1], p[2], u, v) || !is_left(p[2], p[0], u, v))
        continue;
      if (claim)
        *owner = triangle;
      else if (*owner >= 0)
        return true;
    }
  return false;
}

/* Adds the chart of the members: its size, their places in it, and the texels that they own. */
static pags_result place(cutting *c, double axes[2][3]) {
  double lo[2] = {0}, size[2] = {0}, wanted = 0, area = 0;
  turn(c, axes, lo, size);
  for (int64_t m = 0; m < c->count; m++) {
    wanted += c->areas[c->members[m]] * pags_pow((double)c->need[c->members[m]], 2);
    area += c->areas[c->members[m]];
  }
  double density = area > 0 ? c->scale * sqrt(wanted / area) : 0;
  density = fmin(density, (MOST_PIXELS - 2) / fmax(size[0], 1e-30));
  pags_texture *out = c->out;
  const pags_chart chart = {
      .width = (int)ceil(size[0] * density) + 1, .height = (int)ceil(size[1] * density) + 1, .texel = out->texel_count};
  const int64_t texels = out->texel_count + (int64_t)chart.width * chart.height;
  PAGS_CHECK_MEMORY(pags_grow(&out->charts, out->chart_count + 1, &out->chart_capacity, sizeof *out->charts) &&
                        pags_grow(&c->owners, texels, &c->owner_capacity, sizeof *c->owners),
                    "a texture of %lld texels", (long long)texels);
  memset(c->owners + out->texel_count, -1, (size_t)(texels - out->texel_count) * sizeof *c->owners);
  out->charts[out->chart_count++] = chart;
  out->texel_count = texels;
  for (int64_t m = 0; m < c->count; m++) {
    const int64_t t = c->members[m];
    double p[3][3];
    int64_t at[3][2];
    pags_proxy_mesh_corners(c->mesh, t, p);
    for (int k = 0; k < 6; k++)
      at[k / 2][k % 2] = (int64_t)pags_round(UNIT * (0.5 + density * (pags_dot3(p[k / 2], axes[k % 2]) - lo[k % 2])));
    if (m && cover((const int64_t(*)[2])at, &chart, c->owners, (int32_t)t, false)) {
      out->chart_of[t] = -1;
      continue;
    }
    cover((const int64_t(*)[2])at, &chart, c->owners, (int32_t)t, true);
    for (int k = 0; k < 6; k++)
      out->uv[6 * t + k] = (float)at[k / 2][k % 2] / UNIT;
  }
  return PAGS_OK;
}

/* ---- All charts ---- */

/* Sorts the triangles by vertex. */
static void gather(cutting *c) {
  const int64_t vertices = c->mesh->vertex_count, corners = 3 * c->mesh->triangle_count;
  for (int64_t i = 0; i < corners; i++)
    c->first[c->mesh->triangles[i] + 2]++;
  for (int64_t v = 0; v < vertices; v++)
    c->first[v + 2] += c->first[v + 1];
  for (int64_t i = 0; i < corners; i++)
    c->around[c->first[c->mesh->triangles[i] + 1]++] = i / 3;
}

pags_result pags_charts_make(const pags_proxy_mesh *mesh, const float *need, double most, pags_texture *out,
                             int32_t **owners) {
  const size_t triangles = (size_t)mesh->triangle_count;
  PAGS_AUTO(forget_cutting)
  cutting c = {.mesh = mesh,
               .need = need,
               .scale = 1,
               .normals = malloc((triangles + 1) * sizeof *c.normals),
               .areas = malloc((triangles + 1) * sizeof *c.areas),
               .first = calloc((size_t)mesh->vertex_count + 3, sizeof *c.first),
               .around = malloc((3 * triangles + 1) * sizeof *c.around),
               .members = malloc((triangles + 1) * sizeof *c.members),
               .out = out};
  PAGS_AUTOFREE seed *seeds = malloc((triangles + 1) * sizeof *seeds);
  out->uv = calloc(6 * triangles + 1, sizeof *out->uv);
  out->chart_of = malloc((triangles + 1) * sizeof *out->chart_of);
  PAGS_CHECK_MEMORY(c.normals && c.areas && c.first && c.around && c.members && seeds && out->uv && out->chart_of,
                    "a texture of %zu triangles", triangles);
  gather(&c);
  double texels = 0;
  for (int64_t t = 0; t < mesh->triangle_count; t++) {
    pags_proxy_mesh_cross(mesh, t, c.normals[t]);
    const double length = pags_length3(c.normals[t]);
    pags_divide3(c.normals[t], length > 0 ? length : 1);
    c.areas[t] = 0.5 * length;
    texels += c.areas[t] * pags_pow((double)need[t], 2);
    seeds[t] = (seed){c.areas[t], t};
    out->chart_of[t] = -1;
  }
  c.scale = texels > most ? sqrt(most / texels) : 1;
  pags_sort(seeds, mesh->triangle_count, sizeof *seeds, compare_seeds);
  for (int64_t i = 0; i < mesh->triangle_count; i++) {
    double axes[2][3];
    if (out->chart_of[seeds[i].triangle] >= 0)
      continue;
    axes_of(c.normals[seeds[i].triangle], axes);
    grow(&c, seeds[i].triangle, (int32_t)out->chart_count, (const double(*)[3])axes);
    PAGS_TRY(place(&c, axes));
  }
  *owners = pags_take(&c.owners);
  return PAGS_OK;
}
