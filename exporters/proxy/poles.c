/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of poles, signs and lamps.
 *
 * The shaft is a prism from the ground to the column's top, or higher, as far as the pictures label the axis a pole. A
 * plate is fitted to the points around the shaft if they are flat, an arm to points far up on one side of it. */
#include "exporters/proxy/background.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/tsdf.h"
#include "maths/maths.h"

enum { LEAST_POINTS = 6 }; /* of a plate or an arm */

/* In metres, but for shares. */
static const double sink = 0.03;        /* how far a foot reaches into the ground */
static const double highest = 14;       /* top of a pole */
static const double climb = 0.25;       /* step in which the top is looked for */
static const double least_share = 0.4;  /* of the pixels that show a point of the axis: a pole's */
static const double beside = 0.1;       /* distance of a plate's points from the shaft, at least */
static const double plate_reach = 0.8;  /* and from the axis, at most */
static const double plate_foot = 1.2;   /* lowest point of a plate above the ground */
static const double least_plate = 0.12; /* half of its width and height, at least */
static const double most_plate = 1;     /* half of its height, at most */
static const double plate_depth = 0.05; /* thickness of a plate */
static const double most_depth = 0.12;  /* spread of a plate's points across it (standard deviation) */
static const double round_share = 0.04; /* of points in the corners of a plate that isn't round, at least */
static const double arm_foot = 3.5;     /* lowest point of an arm above the ground */
static const double arm_reach = 4;      /* length of an arm, at most */
static const double least_arm = 0.5;    /* at least */
static const double most_spread = 0.4;  /* of an arm's points across it */
static const double head = 0.8;         /* length of the lamp's head */

/* What a pole is made of. */
typedef struct shape {
  pags_column column;
  bool labelled;
  double plate[6];  /* middle x, y (from the axis), height; half of width and height; direction of the width */
  double plate_off; /* middle of the plate from the axis, along its normal */
  bool has_plate, round, has_arm;
  double arm[3];   /* direction x, y; length */
  double arm_end;  /* height of its end above the ground */
  double arm_wide; /* half of the head's width */
} shape;

static double quantile(double *values, int64_t count, double share) {
  pags_sort_doubles(values, count);
  return values[(int64_t)(share * (double)(count - 1) + 0.5)];
}

/* Keeps the points whose pixels often enough have one of the labels `first`..`last`. */
static void keep_labelled(const pags_depth_views *depth_views, const pags_column *c, int first, int last,
                          pags_near *near) {
  int64_t kept = 0;
  for (int64_t i = 0; i < near->count; i++) {
    double own[PAGS_LABELS] = {0}, p[3], share = 0;
    pags_column_point(c, near->points[i][2], p);
    p[0] += near->points[i][0];
    p[1] += near->points[i][1];
    pags_labels_of_point(depth_views, p, own);
    pags_labels_share(own);
    for (int l = first; l <= last; l++)
      share += own[l];
    if (share >= least_share)
      pags_copy3(near->points[i], near->points[kept++]);
  }
  near->count = kept;
}

/* ---- Finding the parts ---- */

/* Lifts the top as far as the pictures show the pole on its axis. */
static void find_top(const pags_depth_views *depth_views, shape *s) {
  for (double height = s->column.top; height < highest; height += climb) {
    double p[3], votes[PAGS_LABELS] = {0};
    pags_column_point(&s->column, height, p);
    pags_labels_of_point(depth_views, p, votes);
    pags_labels_share(votes);
    if (votes[PAGS_LABEL_POLE] + votes[PAGS_LABEL_LIGHT] + votes[PAGS_LABEL_SIGN] < least_share)
      return;
    s->column.top = height;
  }
}

/* Looks for a plate among the points around the shaft. */
static pags_result find_plate(const pags_depth_views *depth_views, const pags_cloud *cloud, shape *s) {
  PAGS_AUTO(pags_near_destroy) pags_near near = {0};
  double mean[2] = {0}, xx = 0, xy = 0, yy = 0, corners = 0;
  PAGS_TRY(pags_cloud_near(cloud, &s->column, (const double[2]){s->column.radius + beside, plate_reach},
                           (const double[2]){plate_foot, s->column.top + 0.4}, &near));
  if (s->labelled)
    keep_labelled(depth_views, &s->column, PAGS_LABEL_POLE, PAGS_LABEL_SIGN, &near);
  if (near.count < LEAST_POINTS)
    return PAGS_OK;
  PAGS_AUTOFREE double *list = malloc((size_t)near.count * sizeof *list);
  PAGS_CHECK_MEMORY(list, "%lld points", (long long)near.count);

  /* The principal axis, seen from above. */
  for (int64_t i = 0; i < near.count; i++)
    for (int k = 0; k < 2; k++)
      mean[k] += near.points[i][k] / (double)near.count;
  for (int64_t i = 0; i < near.count; i++) {
    const double x = near.points[i][0] - mean[0], y = near.points[i][1] - mean[1];
    xx += x * x / (double)near.count;
    xy += x * y / (double)near.count;
    yy += y * y / (double)near.count;
  }
  const double angle = 0.5 * pags_atan2(2 * xy, xx - yy), u[2] = {pags_cos(angle), pags_sin(angle)};
  const double across = xx * u[1] * u[1] - 2 * xy * u[0] * u[1] + yy * u[0] * u[0];
  if (across > most_depth * most_depth)
    return PAGS_OK;

  double lo[2], hi[2];
  for (int k = 0; k < 2; k++) {
    for (int64_t i = 0; i < near.count; i++)
      list[i] = k ? near.points[i][2] : near.points[i][0] * u[0] + near.points[i][1] * u[1];
    lo[k] = quantile(list, near.count, 0.02);
    hi[k] = quantile(list, near.count, 0.98);
  }
  for (int64_t i = 0; i < near.count; i++)
    list[i] = near.points[i][1] * u[0] - near.points[i][0] * u[1];
  s->plate_off = quantile(list, near.count, 0.5);
  const double middle[2] = {0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1])};
  const double half[2] = {0.5 * (hi[0] - lo[0]) + 0.01, 0.5 * (hi[1] - lo[1]) + 0.01};
  if (half[0] < least_plate || half[1] < least_plate || half[1] > most_plate)
    return PAGS_OK;
  for (int64_t i = 0; i < near.count; i++) {
    const double a = near.points[i][0] * u[0] + near.points[i][1] * u[1] - middle[0], b = near.points[i][2] - middle[1];
    corners += fabs(a) / half[0] + fabs(b) / half[1] > 1.5;
  }
  s->has_plate = true;
  s->round = corners < round_share * (double)near.count;
  const double plate[6] = {middle[0], middle[1], half[0], half[1], u[0], u[1]};
  memcpy(s->plate, plate, sizeof plate);
  return PAGS_OK;
}

/* Looks for an arm: points far up and to one side. */
static pags_result find_arm(const pags_depth_views *depth_views, const pags_cloud *cloud, shape *s) {
  PAGS_AUTO(pags_near_destroy) pags_near near = {0};
  double mean[2] = {0};
  if (s->column.top < arm_foot)
    return PAGS_OK;
  PAGS_TRY(pags_cloud_near(cloud, &s->column, (const double[2]){0.3, arm_reach},
                           (const double[2]){fmax(arm_foot, 0.75 * s->column.top), s->column.top + 1.5}, &near));
  if (s->labelled)
    keep_labelled(depth_views, &s->column, PAGS_LABEL_POLE, PAGS_LABEL_LIGHT, &near);
  if (near.count < LEAST_POINTS)
    return PAGS_OK;
  for (int64_t i = 0; i < near.count; i++)
    for (int k = 0; k < 2; k++)
      mean[k] += near.points[i][k] / (double)near.count;
  const double length = pags_hypot(mean[0], mean[1]);
  if (length < least_arm / 2)
    return PAGS_OK;
  PAGS_AUTOFREE double *along = malloc(3 * (size_t)near.count * sizeof *along);
  PAGS_CHECK_MEMORY(along, "%lld points", (long long)near.count);
  double *across = along + near.count, *height = across + near.count;
  for (int64_t i = 0; i < near.count; i++) {
    const double *p = near.points[i];
    along[i] = (p[0] * mean[0] + p[1] * mean[1]) / length;
    across[i] = fabs(p[1] * mean[0] - p[0] * mean[1]) / length;
    height[i] = p[2];
  }
  const double arm[3] = {mean[0] / length, mean[1] / length, quantile(along, near.count, 0.95)};
  s->arm_wide = fmax(0.08, quantile(across, near.count, 0.9));
  s->arm_end = quantile(height, near.count, 0.6);
  s->has_arm = arm[2] > least_arm && s->arm_wide < most_spread;
  pags_copy3(arm, s->arm);
  return PAGS_OK;
}

/* ---- The mesh ---- */

static void add_plate(const shape *s, pags_proxy_mesh *mesh) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const double *p = s->plate, u[2] = {p[4], p[5]}, cut = 0.41421356;
  const double square[4][2] = {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
  double rings[2][8][3], axis[3];
  const int sides = s->round ? 8 : 4;
  for (int r = 0; r < 2; r++)
    for (int i = 0; i < sides; i++) {
      /* The corners of a square, or of the octagon in it. */
      double a = square[s->round ? i / 2 : i][0], b = square[s->round ? i / 2 : i][1];
      if (s->round && (i % 2 == 0) == (a * b > 0))
        b *= cut;
      else if (s->round)
        a *= cut;
      const double along = p[0] + a * p[2], height = p[1] + b * p[3];
      const double off = s->plate_off + (r ? -0.5 : 0.5) * plate_depth;
      pags_column_point(&s->column, height, axis);
      const double corner[3] = {axis[0] + along * u[0] - off * u[1], axis[1] + along * u[1] + off * u[0], axis[2]};
      pags_copy3(corner, rings[r][i]);
    }
  pags_proxy_mesh_prism(mesh, sides, rings[0], rings[1], grey, (const bool[2]){true, true});
}

/* Adds a box along a line from `from` to `to`, with half its width across and half its height. */
static void add_beam(const double from[3], const double to[3], const double across[2], double wide, double tall,
                     pags_proxy_mesh *mesh) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  static const double square[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  double rings[2][4][3];
  for (int r = 0; r < 2; r++)
    for (int i = 0; i < 4; i++) {
      pags_copy3(r ? to : from, rings[r][i]);
      rings[r][i][0] += square[i][0] * wide * across[0];
      rings[r][i][1] += square[i][0] * wide * across[1];
      rings[r][i][2] += square[i][1] * tall;
    }
  pags_proxy_mesh_prism(mesh, 4, rings[0], rings[1], grey, (const bool[2]){true, true});
}

static void add_arm(const shape *s, pags_proxy_mesh *mesh) {
  const double across[2] = {-s->arm[1], s->arm[0]}, end = s->arm[2], begin = fmax(end - head, 0.5 * end);
  double top[3], middle[3], tip[3];
  pags_column_point(&s->column, s->column.top - 0.1, top);
  pags_column_point(&s->column, s->arm_end, tip);
  pags_copy3(tip, middle);
  for (int k = 0; k < 2; k++) {
    tip[k] += end * s->arm[k];
    middle[k] += begin * s->arm[k];
  }
  add_beam(top, middle, across, 0.05, 0.05, mesh);
  add_beam(middle, tip, across, s->arm_wide, 0.08, mesh);
}

static pags_result make_pole(const pags_proxy_maker *w, pags_background *b, const pags_cloud *fused,
                             const pags_column *column) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh mesh = {0};
  shape s = {.column = *column, .labelled = b->labelled};
  if (s.labelled)
    find_top(&b->depth_views, &s);
  PAGS_TRY(find_plate(&b->depth_views, &b->cloud, &s));
  if (!s.has_plate)
    PAGS_TRY(find_arm(&b->depth_views, &b->cloud, &s));
  if (!s.has_plate && !s.has_arm)
    PAGS_TRY(find_arm(&b->depth_views, fused, &s));
  pags_column_prism(&s.column, s.has_arm ? 6 : 8, -sink, s.column.top, true, &mesh);
  if (s.has_plate)
    add_plate(&s, &mesh);
  if (s.has_arm)
    add_arm(&s, &mesh);
  PAGS_TRY(pags_proxy_mesh_check(&mesh));
  PAGS_TRY(pags_proxy_mesh_paint(&mesh, &b->depth_views, 0.3, w->tasks));
  return pags_background_add_solid(b, s.has_plate ? "sign" : s.has_arm ? "lamp" : "pole", &mesh);
}

pags_result pags_poles_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                            pags_proxy_mesh *joined) {
  PAGS_AUTO(pags_cloud_destroy) pags_cloud fused = {0};
  PAGS_TRY(pags_cloud_make(joined->positions, joined->vertex_count, ground, &b->depth_views, &fused));
  for (int64_t i = 0; i < b->columns.count; i++)
    if (pags_column_kind_of(&b->columns.list[i], b->labelled) == PAGS_COLUMN_POLE)
      PAGS_TRY(make_pole(w, b, &fused, &b->columns.list[i]));
  return pags_fences_make(w, b, ground);
}
