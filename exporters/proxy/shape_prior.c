/* SPDX-License-Identifier: Apache-2.0 */
/* Completes what no camera saw of an object. For a vehicle: by its mirror image and by a shape prior, the blended
 * signed distances of other vehicles of about its size, weighted by how well the LiDAR points on it fit them; then
 * wheels and the space between its sides are completed by rule. Any other object: by its labelled box. */
#include "exporters/proxy/shape_prior.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum {
  NX = 112,
  NY = 56,
  NZ = 48,
  POINTS = NX * NY * NZ
}; /* points at distances of 4 to 5 cm on a car; a mirror has 10 cm */
static const double reach = 0.55; /* half extents of the lattice, as a share of the box's size */

/* The likeness of two sizes is a Gaussian of the logarithm of their ratio with this standard deviation (vehicles of
 * one kind, and labels of one vehicle, differ by a few per cent); a smaller likeness than `least_likeness` is 0. */
static const double size_spread = 0.08, least_likeness = 0.02;

/* Weights of grid points are in views that have a pixel for every step of the grid. A shape knows a point fully
 * (`known` = 1) from `sure` such views on. Points that all shapes of alike size together know less than `least_known`
 * are left out: mostly shadows. */
static const double sure = 4;
static const float least_known = 0.3f;

/* At a point that the prior knows fully, the prior counts like `prior_weight` views; linearly less the more the
 * object's own views saw of the point, and nothing from `seen_well` views on. Many distant views are no better than
 * few: they all look from one side and have the same error in depth. */
static const double prior_weight = 16, seen_well = 12;

/* How LiDAR points weigh the shapes. The distance of a point from a shape's surface is cut off at `far_off` metres
 * (the shapes' TSDFs are truncated at four grid steps). `tells`, in metres, is the standard deviation of that
 * distance, by noise and by the differences of cars of one kind. At most `most_points` points count as independent. A
 * shape that fits badly keeps `least_weight`, for places that no better one knows. */
static const double far_off = 0.14, tells = 0.08, most_points = 60, least_weight = 0.03;
enum { ROUNDS = 3 }; /* rounds of reweighting the shapes: weigh_by_cloud */

/* LiDAR points farther than this from the completed surface are ignored, in metres: they lie on something else, or
 * where the views saw a different shape. */
static const double lidar_reach = 0.13;

/* A point that views of at least the weight `seen_free` say is free stays free. The search for a vehicle's sides
 * begins `mirrors` metres inside the box's sides, which may be as wide as the mirrors. */
static const double seen_free = 1, mirrors = 0.12;

/* In metres above the box's lower face: unseen space below `clearance` is the air under the vehicle; between its
 * sides above `body` there is only body. */
static const double clearance = 0.20, body = 0.35;

/* Wheels, in metres. They are looked for `wheels_from` above the box's lower face, where they are `shortest_wheel` to
 * `longest_wheel` long and `wheel_width` wide; tyres are flattened by `flat` where they stand on the ground.
 * `off_middle` is their least distance from the vehicle's middle as a share of its length. SEEN_DEPTH: grid steps of
 * a wheel's width that the views themselves fill. */
static const double flat = 0.02, wheels_from = 0.15, shortest_wheel = 0.3, longest_wheel = 0.8, wheel_width = 0.22,
                    off_middle = 0.15;
enum { SEEN_DEPTH = 4 };

static const float meet = 0.02f; /* distance to a surface half way between two lattice points; metres */

void pags_shape_prior_destroy(pags_shape_prior *prior) {
  free(prior->distance);
  free(prior->known);
  *prior = (pags_shape_prior){0};
}

/* ---- The lattice ---- */

static pags_result make_room(const double size[3], int64_t object, pags_shape_prior *out) {
  *out = (pags_shape_prior){.object = object,
                            .size = {size[0], size[1], size[2]},
                            .distance = calloc(POINTS, sizeof(float)),
                            .known = calloc(POINTS, sizeof(float))};
  PAGS_CHECK_MEMORY(out->distance && out->known, "the shape prior of an object");
  return PAGS_OK;
}

/* The position of lattice point `i` of a box of this size, in the object's frame. */
static void point_of(const double size[3], int i, double p[3]) {
  const int at[3] = {i % NX, i / NX % NY, i / NX / NY}, n[3] = {NX, NY, NZ};
  for (int k = 0; k < 3; k++)
    p[k] = size[k] * reach * (2.0 * at[k] / (n[k] - 1) - 1);
}

/* Interpolates a lattice's values trilinearly at lattice coordinates `u`, over the known points only. Returns how
 * well the value is known. Returns 0 if less than half of the interpolation weight is on known points, since else
 * space that was seen to be free would reach a step into unseen space. */
static double between(const int n[3], const float *values, const float *known, const double u[3], double *value) {
  int64_t stride[3] = {1, n[0], (int64_t)n[0] * n[1]}, at = 0;
  double part[3], sum = 0, weight = 0, share = 0;
  for (int k = 0; k < 3; k++) {
    double low = fmin(floor(u[k]), n[k] - 2);
    if (!(low >= 0 && u[k] <= n[k] - 1))
      return 0;
    part[k] = u[k] - low;
    at += (int64_t)low * stride[k];
  }
  for (int c = 0; c < 8; c++) {
    int64_t i = at + (c & 1) + (c >> 1 & 1) * stride[1] + (c >> 2) * stride[2];
    double w = (c & 1 ? part[0] : 1 - part[0]) * (c & 2 ? part[1] : 1 - part[1]) * (c & 4 ? part[2] : 1 - part[2]);
    share += known[i] > 0 ? w : 0;
    sum += w * (double)known[i] * (double)values[i];
    weight += w * (double)known[i];
  }
  *value = weight > 0 ? sum / weight : 0;
  return share >= 0.5 ? weight : 0;
}

/* Samples a TSDF at a point; returns the weight, 0: unknown. */
static double look_up(const pags_tsdf *g, const double p[3], double *distance) {
  double u[3];
  for (int k = 0; k < 3; k++)
    u[k] = (p[k] - g->origin[k]) / g->step;
  return between(g->n, g->distance, g->weight, u, distance);
}

pags_result pags_shape_prior_take(const pags_tsdf *grid, const double size[3], int64_t object, pags_shape_prior *out) {
  PAGS_TRY(make_room(size, object, out));
  for (int i = 0; i < POINTS; i++) {
    double p[3];
    point_of(size, i, p);
    double distance, weight = look_up(grid, p, &distance);
    p[1] = -p[1];
    if (!(weight > 0))
      weight = look_up(grid, p, &distance);
    if (!(weight > 0))
      continue;
    out->distance[i] = (float)distance;
    out->known[i] = (float)fmin(1, weight / sure);
  }

  /* If the lattice point below a free point in the box is unknown, put a surface half way between the two: the roof
   * of a vehicle as high as the cameras is never seen. The free point's distance is the truncation, which says
   * nothing of how far the roof is, but would outvote shapes that know the roof. */
  for (int i = NX * NY; i < POINTS; i++) {
    int below = i - NX * NY;
    double p[3];
    point_of(out->size, below, p);
    if (!(out->known[i] > 0) || out->known[below] > 0 || !(out->distance[i] > 0) || p[2] < body - 0.5 * out->size[2] ||
        p[2] > 0.5 * out->size[2] || fabs(p[0]) > 0.5 * out->size[0] || fabs(p[1]) > 0.5 * out->size[1])
      continue;
    out->distance[i] = fminf(out->distance[i], meet);
    out->distance[below] = -meet;
    out->known[below] = out->known[i];
  }

  return PAGS_OK;
}

/* ---- Blending shapes ---- */

/* How alike two box sizes are, 0..1. */
static double likeness(const double a[3], const double b[3]) {
  double sum = 0;
  for (int k = 0; k < 3; k++) {
    double r = pags_log(a[k] / b[k]) / size_spread;
    sum += r * r;
  }
  return pags_exp(-0.5 * sum) < least_likeness ? 0 : pags_exp(-0.5 * sum);
}

/* Samples a shape at a point of its own vehicle's frame; returns how well it is known, 0..1. */
static double sample(const pags_shape_prior *prior, const double p[3], double *distance) {
  static const int n[3] = {NX, NY, NZ};
  double u[3];
  for (int k = 0; k < 3; k++)
    u[k] = (p[k] / (prior->size[k] * reach) + 1) * 0.5 * (n[k] - 1);
  return between(n, prior->distance, prior->known, u, distance);
}

/* A LiDAR point against one shape: how well the shape is known there, and the squared distance from its surface. */
typedef struct fit {
  double known, square;
} fit;

/* Adds the misfit of one LiDAR point to the misfit of each shape. As far as a shape doesn't know the point's place,
 * it gets the mean misfit of the shapes that do, weighted by `trust`; else hardly seen shapes would win. */
static void add_misfits(const fit *fits, int64_t count, const float *trust, float *misfits) {
  double sum = 0, weight = 0;
  for (int64_t f = 0; f < count; f++)
    if (trust[f] > 0) {
      double known = (double)trust[f] * fits[f].known;
      sum += known * fits[f].square;
      weight += known;
    }
  double mean = weight > 0 ? sum / weight : far_off * far_off;
  for (int64_t f = 0; f < count; f++)
    if (trust[f] > 0)
      misfits[f] += (float)(mean + fits[f].known * (fits[f].square - mean));
}

/* Weighs the shapes by their likelihood given the LiDAR points, relative to the shape that fits best, for normally
 * distributed distances. The mean misfit in add_misfits depends on these weights: the first round starts with the
 * likeness of sizes `like`, each further round with the weights of the round before. `weights` has room for twice
 * `count`. */
static pags_result weigh_by_cloud(const pags_shape_prior *priors, int64_t count, const double size[3],
                                  const float *like, const pags_lidar_fit *cloud, float *weights) {
  double points = fmin((double)cloud->count, most_points);
  float *misfits = weights + count;
  PAGS_AUTOFREE fit *fits = calloc((size_t)cloud->count * (size_t)count + 1, sizeof *fits);
  PAGS_CHECK_MEMORY(fits, "%lld points of LiDAR", (long long)cloud->count);
  for (int64_t i = 0; i < cloud->count * count; i++) {
    const pags_shape_prior *prior = &priors[i % count];
    double p[3], d = 0;
    if (!(like[i % count] > 0))
      continue;
    for (int k = 0; k < 3; k++)
      p[k] = (double)cloud->points[3 * (i / count) + k] * prior->size[k] / size[k];
    fits[i].known = sample(prior, p, &d);
    fits[i].square = fmin(d * d, far_off * far_off);
  }
  memcpy(weights, like, (size_t)count * sizeof *weights);
  for (int round = 0; round < ROUNDS; round++) {
    double least = HUGE_VAL;
    memset(misfits, 0, (size_t)count * sizeof *misfits);
    for (int64_t i = 0; i < cloud->count; i++)
      add_misfits(fits + i * count, count, weights, misfits);
    for (int64_t f = 0; f < count; f++)
      if (like[f] > 0)
        least = fmin(least, (double)misfits[f]);
    for (int64_t f = 0; f < count; f++) {
      double worse = ((double)misfits[f] - least) / (double)cloud->count;
      weights[f] =
          like[f] > 0 ? like[f] * (float)(least_weight + pags_exp(-0.5 * points * worse / (tells * tells))) : 0;
    }
  }
  return PAGS_OK;
}

pags_result pags_shape_prior_blend(const pags_shape_prior *priors, int64_t count, const double size[3], int64_t object,
                                   const pags_lidar_fit *cloud, pags_shape_prior *out) {
  float all = 0;
  PAGS_AUTOFREE float *like = calloc(3 * (size_t)count + 1, sizeof *like);
  *out = (pags_shape_prior){0};
  PAGS_CHECK_MEMORY(like, "%lld forms", (long long)count);
  for (int64_t f = 0; f < count; f++) {
    like[f] = priors[f].distance && priors[f].object != object ? (float)likeness(priors[f].size, size) : 0;
    all += like[f];
  }
  if (!(all > 0))
    return PAGS_OK;
  float *weights = cloud && cloud->count ? like + count : like;
  if (weights != like)
    PAGS_TRY(weigh_by_cloud(priors, count, size, like, cloud, weights));
  PAGS_TRY(make_room(size, object, out));

  /* Blend the shapes point by point: the distance is their mean by `weights` (which shapes LiDAR fits), how well it is
   * known their sum by `like` (size alone). */
  for (int i = 0; i < POINTS; i++) {
    float sum = 0, total = 0, known = 0;
    for (int64_t f = 0; f < count; f++)
      if (like[f] > 0) {
        sum += weights[f] * priors[f].known[i] * priors[f].distance[i];
        total += weights[f] * priors[f].known[i];
        known += like[f] * priors[f].known[i];
      }
    out->distance[i] = total > 0 ? sum / total : 0;
    out->known[i] = known < least_known ? 0 : fminf(1, known);
  }
  return PAGS_OK;
}

/* ---- Completing a grid ---- */

/* The signed distance to the labelled box, negative inside; a vehicle's box is cut off `clearance` above its lower
 * face. */
static double box_distance(const double size[3], bool vehicle, const double p[3]) {
  double outside = 0, inside = -HUGE_VAL;
  for (int k = 0; k < 3; k++) {
    double d = fabs(p[k]) - 0.5 * size[k];
    outside += d > 0 ? d * d : 0;
    inside = fmax(inside, d);
  }
  double d = inside > 0 ? sqrt(outside) : inside;
  return vehicle ? fmax(d, clearance - 0.5 * size[2] - p[2]) : d;
}

/* Smooths the distances by one pass of the filter 1 2 1 along each axis, which removes the steps where the views had
 * a pixel or less for each voxel. */
static pags_result smooth(pags_tsdf *grid) {
  int64_t strides[3] = {1, grid->n[0], (int64_t)grid->n[0] * grid->n[1]}, count = strides[2] * grid->n[2];
  PAGS_AUTOFREE float *from = malloc((size_t)count * sizeof *from);
  PAGS_CHECK_MEMORY(from, "a grid");
  for (int axis = 0; axis < 3; axis++) {
    memcpy(from, grid->distance, (size_t)count * sizeof *from);
    for (int64_t i = 0; i < count; i++) {
      int64_t x = i / strides[axis] % grid->n[axis];
      if (x > 0 && x + 1 < grid->n[axis])
        grid->distance[i] = 0.25f * (from[i - strides[axis]] + 2 * from[i] + from[i + strides[axis]]);
    }
  }
  return PAGS_OK;
}

/* Completes one grid point: its own distance, or for a vehicle that of its mirror image if only that was seen,
 * averaged with the prior where hardly seen; the labelled box where nothing is known. */
static void fill_point(pags_tsdf *grid, const float *own, const double size[3], bool vehicle,
                       const pags_shape_prior *prior, const int at[3]) {
  int64_t row = grid->n[0], layer = row * grid->n[1];
  int64_t here = at[2] * layer + at[1] * row + at[0], mirror = at[2] * layer + (grid->n[1] - 1 - at[1]) * row + at[0];
  double p[3], d = 0, weight = (double)grid->weight[here], value = (double)own[here], limit = 4 * grid->step, known = 0;
  for (int k = 0; k < 3; k++)
    p[k] = grid->origin[k] + at[k] * grid->step;
  if (!(weight > 0) && vehicle && grid->weight[mirror] > 0) {
    weight = (double)grid->weight[mirror];
    value = (double)own[mirror];
  }
  double room = fmax(0, 1 - weight / seen_well);
  if (prior && room > 0 && (known = prior_weight * room * sample(prior, p, &d)) > 0) {
    value = (weight * value + known * fmin(fmax(d, -limit), limit)) / (weight + known);
    weight += known;
  }
  if (!(weight > 0))
    value = fmin(fmax(box_distance(size, vehicle, p), -3 * grid->step), 3 * grid->step);
  grid->distance[here] = (float)value;
}

/* Fills the space between a vehicle's left and right side above `body` with body, unless it was seen to be free:
 * cameras at the height of a roof don't see the roof, and a prior of cars with a notchback would leave a pit
 * there. */
static void fill_across(pags_tsdf *grid, const double size[3]) {
  int outer = (int)ceil(fmax(0, (-0.5 * size[1] + mirrors - grid->origin[1]) / grid->step));
  for (int z = 0; z < grid->n[2]; z++) {
    if (grid->origin[2] + z * grid->step < body - 0.5 * size[2])
      continue;
    for (int x = 0; x < grid->n[0]; x++) {
      int64_t row = grid->n[0], first = (int64_t)z * row * grid->n[1] + x;
      int side = outer,
          other = grid->n[1] - 1 - outer; /* rows mirrored at the middle; both go inwards until both are solid */
      while (side < other && !(grid->distance[first + side * row] < 0 && grid->distance[first + other * row] < 0)) {
        side++;
        other--;
      }
      for (int y = side + 1; y < other; y++)
        if ((double)grid->weight[first + y * row] < seen_free)
          grid->distance[first + y * row] = fminf(grid->distance[first + y * row], (float)-grid->step);
    }
  }
}

/* Finds the next sign change of the distance along a row of grid points in x, from point `x` on. `place` receives its
 * interpolated x in metres. Returns the first point behind it; -1: the row ends before. */
static int next_change(const pags_tsdf *g, int64_t row, int x, double *place) {
  for (; x + 1 < g->n[0]; x++) {
    double a = (double)g->distance[row + x], b = (double)g->distance[row + x + 1];
    if ((a < 0) != (b < 0)) {
      *place = g->origin[0] + (x + a / (a - b)) * g->step;
      return x + 1;
    }
  }
  return -1;
}

/* Completes a wheel. In layer `top`, row `y`, the wheel is solid from x = `left` to x = `right`; below, it is
 * completed by the circle through these two points that touches the height `lowest`, and inwards as far as wheels are
 * wide. */
static void stand_wheel(pags_tsdf *g, int y, int top, double lowest, double left, double right) {
  double height = g->origin[2] + top * g->step - lowest, half = 0.5 * (right - left), middle = 0.5 * (left + right);
  double radius = (half * half + height * height) / (2 * height);
  int64_t layer = (int64_t)g->n[0] * g->n[1], row = (int64_t)g->n[0] * y,
          inwards = 2 * y < g->n[1] ? g->n[0] : -g->n[0];
  int rows = (int)fmin(fmax(0, wheel_width / g->step - SEEN_DEPTH), (g->n[1] - 1) / 2);
  for (int z = 0; z < top; z++)
    for (int x = 0; x < g->n[0]; x++) {
      double dx = g->origin[0] + x * g->step - middle, dz = g->origin[2] + z * g->step - lowest - radius;
      float round = (float)(sqrt(dx * dx + dz * dz) - radius), *here = g->distance + z * layer + row + x;
      *here = fminf(*here, fmaxf(round, g->distance[top * layer + row + x]));
      for (int i = 1; i <= rows; i++)
        here[i * inwards] = fminf(here[i * inwards], round);
    }
}

pags_result pags_shape_prior_complete(pags_tsdf *grid, const double size[3], bool vehicle,
                                      const pags_shape_prior *prior, const pags_lidar_fit *cloud) {
  size_t count = (size_t)grid->n[0] * (size_t)grid->n[1] * (size_t)grid->n[2];
  PAGS_AUTOFREE float *own = malloc(count * sizeof *own);
  int at[3];
  PAGS_CHECK_MEMORY(own, "a grid");
  memcpy(own, grid->distance, count * sizeof *own);
  for (at[2] = 0; at[2] < grid->n[2]; ++at[2])
    for (at[1] = 0; at[1] < grid->n[1]; ++at[1])
      for (at[0] = 0; at[0] < grid->n[0]; ++at[0])
        fill_point(grid, own, size, vehicle, prior && prior->distance ? prior : NULL, at);
  if (vehicle)
    fill_across(grid, size);
  pags_tsdf_close_border(grid, (float)grid->step);
  PAGS_TRY(smooth(grid));
  if (vehicle) {
    /* Complete the wheels: the lowest Gaussians in the box are the ground's or the shadow's, and tyres are as dark as
     * the shadow, so the views don't show where wheels end. Then cut everything off at the box's lower face. */
    double ground = -0.5 * size[2], left, right;
    int top = (int)ceil((wheels_from - 0.5 * size[2] - grid->origin[2]) / grid->step);
    for (int y = 0; top > 0 && top < grid->n[2] && y < grid->n[1]; y++) {
      int64_t row = ((int64_t)top * grid->n[1] + y) * grid->n[0];
      int x = grid->distance[row] < 0 ? next_change(grid, row, 0, &left) : 0;
      while (x >= 0 && (x = next_change(grid, row, x, &left)) >= 0 && (x = next_change(grid, row, x, &right)) >= 0)
        if (right - left > shortest_wheel && right - left < longest_wheel &&
            0.5 * fabs(left + right) > off_middle * size[0])
          stand_wheel(grid, y, top, ground - flat, left, right);
    }
    for (size_t i = 0; i < count; i++) {
      const int64_t z = (int64_t)i / grid->n[0] / grid->n[1];
      grid->distance[i] = fmaxf(grid->distance[i], (float)(ground - grid->origin[2] - (double)z * grid->step));
    }
  }
  if (cloud)
    PAGS_TRY(pags_lidar_fit_pull(cloud, grid, lidar_reach));
  pags_tsdf_close_border(grid, (float)grid->step);
  return PAGS_OK;
}
