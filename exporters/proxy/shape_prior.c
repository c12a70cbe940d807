/* SPDX-License-Identifier: Apache-2.0 */
/* Completes what no camera saw of an object by a shape prior: signed distances of other objects of its class and about
 * its size, blended. */
#include "exporters/proxy/shape_prior.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { NX = 112, NY = 56, NZ = 48, POINTS = NX * NY * NZ }; /* 4 to 5 cm on a car: a wing mirror is 10 */
static const double reach = 0.55;                           /* of the lattice, in sizes of the box */

/* Sizes that differ by a few per cent are of the same kind of vehicle, or labelled by another hand. */
static const double size_spread = 0.08, least_likeness = 0.02;

/* Weights are counted in views that see every step of the grid with a pixel. A form is sure of a point from `sure` such
 * views on. What forms alike are together less sure of than `least_known` is nobody's: shadows, mostly. */
static const double sure = 4;
static const float least_known = 0.3f;

/* A form that is sure counts for `form_weight` views beside what was hardly seen, less the more was, nothing from
 * `seen_well` views on. What far views show is no help: they all look from one side, and are wrong in depth alike. */
static const double prior_weight = 16, seen_well = 12;

/* Points of LiDAR, metres: farther than `far_off` from a form's surface is all the same (forms end at four steps of
 * their grids), `tells` is what they are off by noise and by cars of a kind being different, and no more than
 * `most_points` tell anything new. A form that fits badly keeps `least_weight`, for what no better one knows. */
static const double far_off = 0.14, tells = 0.08, most_points = 60, least_weight = 0.03;
enum { ROUNDS = 3 }; /* of choosing by whom those that know less are measured */

/* Points farther from the completed surface are of something else, or of what was seen to be different; metres. */
static const double lidar_reach = 0.13;

/* What so many such views say is free is. A vehicle's sides are looked for this far within its box's, which may be
 * those of its mirrors; metres. */
static const double seen_free = 1, mirrors = 0.12;

/* Unseen and lower than this over the box's lower face is the air under a vehicle; from here on there is nothing but
 * body between its sides; metres. */
static const double clearance = 0.20, body = 0.35;

/* Boxes stand on the ground, and tyres are flat by so much there. What wheels are known from, over the box's lower
 * face, how long they are there, how wide they are, and how many steps of that a view shows; metres. How far from the
 * vehicle's middle they are at least, as a share of its length. */
static const double flat = 0.02, wheels_from = 0.15, shortest_wheel = 0.3, longest_wheel = 0.8, wheel_width = 0.22,
                    off_middle = 0.15;
enum { SEEN_DEPTH = 4 };

static const float meet = 0.02f; /* half a step of the lattice; metres */

void pags_shape_prior_destroy(pags_shape_prior *prior) {
  free(prior->distance);
  free(prior->known);
  memset(prior, 0, sizeof *prior);
}

static pags_result make_room(const double size[3], int64_t object, pags_shape_prior *out) {
  *out = (pags_shape_prior){.object = object,
                            .size = {size[0], size[1], size[2]},
                            .distance = calloc(POINTS, sizeof(float)),
                            .known = calloc(POINTS, sizeof(float))};
  if (out->distance && out->known)
    return PAGS_OK;
  pags_shape_prior_destroy(out);
  return pags_out_of_memory("the form of an object");
}

static void point_of(const double size[3], int i, double p[3]) {
  const int at[3] = {i % NX, i / NX % NY, i / NX / NY}, n[3] = {NX, NY, NZ};
  for (int k = 0; k < 3; k++)
    p[k] = size[k] * reach * (2.0 * at[k] / (n[k] - 1) - 1);
}

/* Between a lattice's points, of those known; returns how well it is known: not at all where most of what is next to it
 * isn't, or what is seen to be free would reach a step into what nobody sees. */
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

  /* Where nobody sees what is below a free point in the box, half way is a surface: a roof at the height of cameras.
   * The free point is as free as can be, which says nothing of how far the roof is, and would outvote the forms that
   * know better. */
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

static double likeness(const double a[3], const double b[3]) {
  double sum = 0;
  for (int k = 0; k < 3; k++) {
    double r = log(a[k] / b[k]) / size_spread;
    sum += r * r;
  }
  return exp(-0.5 * sum) < least_likeness ? 0 : exp(-0.5 * sum);
}

static double sample(const pags_shape_prior *prior, const double p[3], double *distance) {
  static const int n[3] = {NX, NY, NZ};
  double u[3];
  for (int k = 0; k < 3; k++)
    u[k] = (p[k] / (prior->size[k] * reach) + 1) * 0.5 * (n[k] - 1);
  return between(n, prior->distance, prior->known, u, distance);
}

/* How a point of LiDAR lies to a form: how well the form knows, and how far off its surface that is, squared. */
typedef struct fit {
  double known, square;
} fit;

static fit fit_point(const pags_shape_prior *prior, const double size[3], const float *point) {
  double p[3], d = 0;
  for (int k = 0; k < 3; k++)
    p[k] = (double)point[k] * prior->size[k] / size[k];
  double known = sample(prior, p, &d);
  return (fit){known, fmin(d * d, far_off * far_off)};
}

/* Adds to each form's misfit that of a point. For points that it knows nothing of, a form answers as the others do that
 * count (`trust`), or those that were hardly seen would win. */
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

/* What each form counts beside the one that the points fit best: its likelihood, if points are off by normal deviates.
 * Who counts follows from who fits: first all do that are alike, then by what came of that. `weights` has room for
 * twice `count`. */
static pags_result weigh_by_cloud(const pags_shape_prior *priors, int64_t count, const double size[3],
                                  const float *like, const pags_lidar_fit *cloud, float *weights) {
  double points = fmin((double)cloud->count, most_points);
  float *misfits = weights + count;
  fit *fits = calloc((size_t)cloud->count * (size_t)count + 1, sizeof *fits);
  if (!fits)
    return pags_out_of_memory("%lld points of LiDAR", (long long)cloud->count);
  for (int64_t i = 0; i < cloud->count * count; i++)
    if (like[i % count] > 0)
      fits[i] = fit_point(&priors[i % count], size, cloud->points + 3 * (i / count));
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
      weights[f] = like[f] > 0 ? like[f] * (float)(least_weight + exp(-0.5 * points * worse / (tells * tells))) : 0;
    }
  }
  free(fits);
  return PAGS_OK;
}

/* What alike forms say, whether LiDAR fits them or not, is known; how far the surface is, those say that it fits.
 */
static void add_priors(const pags_shape_prior *priors, int64_t count, const float *like, const float *weights,
                       pags_shape_prior *out) {
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
}

pags_result pags_shape_prior_blend(const pags_shape_prior *priors, int64_t count, const double size[3], int64_t object,
                                   const pags_lidar_fit *cloud, pags_shape_prior *out) {
  float total = 0, *like = calloc(3 * (size_t)count + 1, sizeof *like);
  *out = (pags_shape_prior){0};
  if (!like)
    return pags_out_of_memory("%lld forms", (long long)count);
  for (int64_t f = 0; f < count; f++) {
    like[f] = priors[f].distance && priors[f].object != object ? (float)likeness(priors[f].size, size) : 0;
    total += like[f];
  }
  float *weights = like;
  pags_result result = PAGS_OK;
  if (total > 0 && cloud && cloud->count)
    result = weigh_by_cloud(priors, count, size, like, cloud, weights = like + count);
  if (total > 0 && result == PAGS_OK)
    result = make_room(size, object, out);
  if (total > 0 && result == PAGS_OK)
    add_priors(priors, count, like, weights, out);
  free(like);
  return result;
}

/* Signed distance to the labelled box, negative inside, without the air under a vehicle. */
static double box_distance(const double size[3], int vehicle, const double p[3]) {
  double outside = 0, inside = -HUGE_VAL;
  for (int k = 0; k < 3; k++) {
    double d = fabs(p[k]) - 0.5 * size[k];
    outside += d > 0 ? d * d : 0;
    inside = fmax(inside, d);
  }
  double d = inside > 0 ? sqrt(outside) : inside;
  return vehicle ? fmax(d, clearance - 0.5 * size[2] - p[2]) : d;
}

/* One pass of 1 2 1 along each axis takes the steps out of what was seen at a pixel or less a voxel. */
static pags_result smooth(pags_tsdf *grid) {
  int64_t strides[3] = {1, grid->n[0], (int64_t)grid->n[0] * grid->n[1]}, count = strides[2] * grid->n[2];
  float *from = malloc((size_t)count * sizeof *from);
  if (!from)
    return pags_out_of_memory("a grid");
  for (int axis = 0; axis < 3; axis++) {
    memcpy(from, grid->distance, (size_t)count * sizeof *from);
    for (int64_t i = 0; i < count; i++) {
      int64_t x = i / strides[axis] % grid->n[axis];
      if (x > 0 && x + 1 < grid->n[axis])
        grid->distance[i] = 0.25f * (from[i - strides[axis]] + 2 * from[i] + from[i + strides[axis]]);
    }
  }
  free(from);
  return PAGS_OK;
}

static void fill_point(pags_tsdf *grid, const float *own, const double size[3], int vehicle,
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

/* Vehicles have no pits: between a left and a right side there is body, unless that was seen to be free. Cameras at the
 * height of a roof don't see it, and forms of cars with a tail say that there is none. */
static void fill_across(pags_tsdf *grid, const double size[3]) {
  int outer = (int)ceil(fmax(0, (-0.5 * size[1] + mirrors - grid->origin[1]) / grid->step));
  for (int z = 0; z < grid->n[2]; z++) {
    if (grid->origin[2] + z * grid->step < body - 0.5 * size[2])
      continue;
    for (int x = 0; x < grid->n[0]; x++) {
      int64_t row = grid->n[0], first = (int64_t)z * row * grid->n[1] + x;
      int side = outer,
          other = grid->n[1] - 1 - outer; /* where both sides are solid: the grid is even about the middle */
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

/* Where a row of points along x changes sign next, between the points; returns the first point behind it, -1 at the
 * row's end. */
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

/* What is solid from `left` to `right` in a row of layer `top` goes on down to `lowest` by the circle through there,
 * and inwards as far as wheels are wide. */
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

static void close_border(pags_tsdf *grid) {
  for (int64_t i = 0; i < (int64_t)grid->n[0] * grid->n[1] * grid->n[2]; i++) {
    int64_t x = i % grid->n[0], y = i / grid->n[0] % grid->n[1], z = i / grid->n[0] / grid->n[1];
    if (x == 0 || y == 0 || z == 0 || x + 1 == grid->n[0] || y + 1 == grid->n[1] || z + 1 == grid->n[2])
      grid->distance[i] = (float)grid->step;
  }
}

pags_result pags_shape_prior_complete(pags_tsdf *grid, const double size[3], int vehicle, const pags_shape_prior *prior,
                                      const pags_lidar_fit *cloud) {
  size_t count = (size_t)grid->n[0] * (size_t)grid->n[1] * (size_t)grid->n[2];
  float *own = malloc(count * sizeof *own);
  int at[3];
  if (!own)
    return pags_out_of_memory("a grid");
  memcpy(own, grid->distance, count * sizeof *own);
  for (at[2] = 0; at[2] < grid->n[2]; ++at[2])
    for (at[1] = 0; at[1] < grid->n[1]; ++at[1])
      for (at[0] = 0; at[0] < grid->n[0]; ++at[0])
        fill_point(grid, own, size, vehicle, prior && prior->distance ? prior : NULL, at);
  free(own);
  if (vehicle)
    fill_across(grid, size);
  close_border(grid);
  PAGS_TRY(smooth(grid));
  if (vehicle) {
    /* The lowest Gaussians are the ground's or the shadow's, and tyres are as dark as that, so views don't show where
     * wheels end. */
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
    for (int64_t i = 0; i < (int64_t)grid->n[0] * grid->n[1] * grid->n[2]; i++)
      grid->distance[i] = fmaxf(grid->distance[i],
                                (float)(ground - grid->origin[2] - (double)(i / grid->n[0] / grid->n[1]) * grid->step));
  }
  if (cloud)
    PAGS_TRY(pags_lidar_fit_pull(cloud, grid, lidar_reach));
  close_border(grid);
  return PAGS_OK;
}
