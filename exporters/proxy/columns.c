/* SPDX-License-Identifier: Apache-2.0 */
/* Finds upright thin things in a cloud of points.
 *
 * A column begins at a cell with more points than its neighbours and is moved to the mean of the points around it. It
 * is one if most slices of its lower part have points near the axis and few around it. The slices' medians give the
 * axis, its lean by the median of their slopes (Theil 1950, Sen 1968); a circle fitted to the points (Kasa 1976) gives
 * the radius of thick ones. */
#include "exporters/proxy/columns.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

enum {
  MOST_SIDES = 8,    /* of a prism */
  SLICES = 48,       /* of a column, from `lowest` up */
  LOWER_SLICES = 12, /* that decide whether it is one */
  LEAST_SLICES = 3,  /* with points on the column alone */
  LEAST_POINTS = 8,  /* on it */
  MOST_GAP = 3,      /* slices without points */
  MOST_VOTERS = 48   /* points whose pixels are looked at */
};

/* In metres, but for shares. */
static const double cell = 0.25, slice = 0.25;            /* side of a cell, height of a slice */
static const double lowest = 0.25, highest = 12;          /* heights above the ground that are looked at */
static const double below = -0.3, pavement = 0.3;         /* heights of points of the ground around a foot */
static const double ground_from = 0.12, ground_to = 0.45; /* their distances from the axis */
static const double reach = 60;                           /* distance of points from a camera */
static const double inner = 0.35, outer = 0.75; /* distance from the axis: of a column's points; of those around */
static const double least_radius = 0.065;       /* as thick as its place is uncertain */
static const double crown_foot = 2.25, crown_reach = 2; /* lowest height of a crown; distance from the axis */
static const double hidden = 0.5;                       /* behind the surface that a pixel shows: hidden */
static const double most_around = 0.34;                 /* points around it, for each on it */
static const double least_share = 0.25;                 /* of the pixels that show a pole or a trunk */
static const double least_thin = 0.6;                   /* share of the lower slices with points on the column alone */

void pags_cloud_destroy(pags_cloud *cloud) {
  free(cloud->first);
  free(cloud->points);
  *cloud = (pags_cloud){0};
}

void pags_near_destroy(pags_near *near) {
  free(near->points);
  *near = (pags_near){0};
}

void pags_columns_destroy(pags_columns *columns) {
  free(columns->list);
  *columns = (pags_columns){0};
}

/* ---- The cloud ---- */

static int64_t cell_of(const pags_cloud *c, double x, double y) {
  const double i = floor((x - c->x0) / cell), j = floor((y - c->y0) / cell);
  return i >= 0 && j >= 0 && i < (double)c->nx && j < (double)c->ny ? (int64_t)j * c->nx + (int64_t)i : -1;
}

pags_result pags_cloud_make(const float *points, int64_t count, const pags_ground *ground,
                            const pags_depth_views *depth_views, pags_cloud *out) {
  double lo[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  *out = (pags_cloud){0};
  for (int64_t i = 0; i < depth_views->count; i++) {
    double eye[3];
    pags_pose_position(depth_views->list[i].camera.world_from_camera, eye);
    pags_box_add3(eye, lo, hi);
  }
  if (!count || !ground->nx || !depth_views->count)
    return PAGS_OK;
  out->x0 = lo[0] - reach;
  out->y0 = lo[1] - reach;
  out->nx = (int64_t)ceil((hi[0] - lo[0] + 2 * reach) / cell);
  out->ny = (int64_t)ceil((hi[1] - lo[1] + 2 * reach) / cell);
  out->first = calloc((size_t)(out->nx * out->ny) + 2, sizeof *out->first);
  PAGS_AUTOFREE float *heights = malloc((size_t)count * sizeof *heights);
  PAGS_CHECK_MEMORY(out->first && heights, "%lld points", (long long)count);

  /* A counting sort: the number of each cell's points, where they begin, the points. */
  for (int64_t i = 0; i < count; i++) {
    const double x = (double)points[3 * i], y = (double)points[3 * i + 1];
    const int64_t at = cell_of(out, x, y);
    double z;
    heights[i] = at >= 0 && pags_ground_nearest(ground, x, y, &z) ? (float)((double)points[3 * i + 2] - z) : -1;
    if ((double)heights[i] >= below && (double)heights[i] < highest)
      out->first[at + 2]++;
  }
  for (int64_t i = 0; i < out->nx * out->ny; i++)
    out->first[i + 2] += out->first[i + 1];
  out->points = malloc(((size_t)out->first[out->nx * out->ny + 1] + 1) * 4 * sizeof *out->points);
  PAGS_CHECK_MEMORY(out->points, "%lld points", (long long)count);
  for (int64_t i = 0; i < count; i++)
    if ((double)heights[i] >= below && (double)heights[i] < highest) {
      float *p = out->points + 4 * out->first[cell_of(out, (double)points[3 * i], (double)points[3 * i + 1]) + 1]++;
      pags_copy3f(points + 3 * i, p);
      p[3] = heights[i];
    }
  return PAGS_OK;
}

/* The lattice's cells within `distance` of x, y, as lowest and highest column and row. */
static void cells_around(const pags_cloud *c, double x, double y, double distance, int64_t range[4]) {
  range[0] = (int64_t)fmax(0, floor((x - distance - c->x0) / cell));
  range[1] = (int64_t)fmin((double)c->nx - 1, floor((x + distance - c->x0) / cell));
  range[2] = (int64_t)fmax(0, floor((y - distance - c->y0) / cell));
  range[3] = (int64_t)fmin((double)c->ny - 1, floor((y + distance - c->y0) / cell));
}

void pags_column_point(const pags_column *c, double height, double out[3]) {
  out[0] = c->foot[0] + height * c->lean[0];
  out[1] = c->foot[1] + height * c->lean[1];
  out[2] = c->foot[2] + height;
}

void pags_column_prism(const pags_column *c, int sides, double from, double to, bool foot_seen, pags_proxy_mesh *mesh) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  double rings[2][MOST_SIDES][3];
  for (int r = 0; r < 2; r++)
    for (int i = 0; i < sides; i++) {
      const double angle = 6.283185307179586 * i / sides;
      pags_column_point(c, r ? to : from, rings[r][i]);
      rings[r][i][0] += c->radius * pags_cos(angle);
      rings[r][i][1] += c->radius * pags_sin(angle);
    }
  pags_proxy_mesh_prism(mesh, sides, rings[0], rings[1], grey, (const bool[2]){foot_seen, true});
}

pags_result pags_cloud_near(const pags_cloud *cloud, const pags_column *column, const double distances[2],
                            const double heights[2], pags_near *out) {
  double middle[3];
  int64_t range[4];
  out->count = 0;
  if (!cloud->first)
    return PAGS_OK;
  pags_column_point(column, 0.5 * (heights[0] + heights[1]), middle);
  cells_around(cloud, middle[0], middle[1], distances[1] + 0.5, range);
  for (int64_t j = range[2]; j <= range[3] && range[0] <= range[1]; j++)
    for (int64_t i = cloud->first[j * cloud->nx + range[0]]; i < cloud->first[j * cloud->nx + range[1] + 1]; i++) {
      double p[3], axis[3];
      pags_widen3(cloud->points + 4 * i, p);
      pags_column_point(column, p[2] - column->foot[2], axis);
      const double d[3] = {p[0] - axis[0], p[1] - axis[1], p[2] - column->foot[2]};
      const double distance = pags_hypot(d[0], d[1]);
      if (distance < distances[0] || distance >= distances[1] || d[2] < heights[0] || d[2] >= heights[1])
        continue;
      PAGS_CHECK_MEMORY(pags_grow(&out->points, out->count + 1, &out->capacity, sizeof *out->points), "points");
      pags_copy3(d, out->points[out->count++]);
    }
  return PAGS_OK;
}

/* ---- Labels ---- */

void pags_labels_of_point(const pags_depth_views *depth_views, const double point[3], double votes[PAGS_LABELS]) {
  for (int64_t i = 0; i < depth_views->count; i++) {
    const pags_depth_view *s = &depth_views->list[i];
    int x, y;
    double z;
    if (!s->labels || !pags_depth_view_project(s, point, &x, &y, &z) || z > reach)
      continue;
    const int64_t at = (int64_t)y * s->camera.width + x;
    const double depth = fabs((double)s->depth[at]);
    if (s->labels[at] < PAGS_LABELS && !(depth > 0 && depth < z - hidden))
      votes[s->labels[at]]++;
  }
}

void pags_labels_share(double votes[PAGS_LABELS]) {
  double sum = 0;
  for (int i = 0; i < PAGS_LABELS; i++)
    sum += votes[i];
  for (int i = 0; i < PAGS_LABELS && sum > 0; i++)
    votes[i] /= sum;
}

/* ---- Columns ---- */

/* The points near a place, by slice. */
typedef struct trial {
  int64_t on[SLICES], around[SLICES]; /* numbers of points */
  bool thin[SLICES];                  /* it has points on the column, and few around */
  pags_near near;                     /* all of them */
  double *scratch;                    /* a number for each */
  int64_t room;
} trial;

static void forget_trial(trial *t) {
  pags_near_destroy(&t->near);
  free(t->scratch);
}

static int slice_of(double height) {
  const double i = floor((height - lowest) / slice);
  return i < 0 || i >= SLICES ? -1 : (int)i;
}

/* Counts the points of all slices and finds the thin ones. Returns whether it is a column by them. */
static bool weigh(trial *t) {
  int occupied = 0, thin = 0;
  int64_t points = 0;
  memset(t->on, 0, sizeof t->on);
  memset(t->around, 0, sizeof t->around);
  for (int64_t i = 0; i < t->near.count; i++) {
    const double *p = t->near.points[i];
    const int s = slice_of(p[2]);
    if (s >= 0)
      ++*(pags_hypot(p[0], p[1]) < inner ? &t->on[s] : &t->around[s]);
  }
  for (int s = 0; s < SLICES; s++) {
    t->thin[s] = t->on[s] && (double)t->around[s] <= most_around * (double)t->on[s];
    if (s < LOWER_SLICES) {
      occupied += t->on[s] || t->around[s];
      thin += t->thin[s];
      points += t->thin[s] ? t->on[s] : 0;
    }
  }
  return thin >= LEAST_SLICES && points >= LEAST_POINTS && thin >= least_thin * occupied;
}

/* The median of a coordinate over the column's points of a slice; NaN without points. */
static double median(trial *t, int s, int axis) {
  int64_t count = 0;
  for (int64_t i = 0; i < t->near.count; i++) {
    const double *p = t->near.points[i];
    if (slice_of(p[2]) == s && pags_hypot(p[0], p[1]) < inner)
      t->scratch[count++] = p[axis];
  }
  pags_sort_doubles(t->scratch, count);
  return count ? t->scratch[count / 2] : (double)NAN;
}

/* The lean of the slices' medians: the median of the slopes of all pairs half a metre or more from each other. */
static double find_lean(trial *t, int axis) {
  double middle[SLICES], slopes[LOWER_SLICES * LOWER_SLICES];
  int64_t count = 0;
  for (int a = 0; a < LOWER_SLICES; a++) {
    middle[a] = t->thin[a] ? median(t, a, axis) : (double)NAN;
    for (int b = 0; b + 2 <= a; b++)
      if (!isnan(middle[a]) && !isnan(middle[b]))
        slopes[count++] = (middle[a] - middle[b]) / ((a - b) * slice);
  }
  pags_sort_doubles(slopes, count);
  return count < 10 || fabs(slopes[count / 2]) > 0.15 ? 0 : slopes[count / 2];
}

/* Fits a circle to the column's points of slices that are marked: the least squares of x^2 + y^2 + a x + b y + c.
 * Returns its radius, and its middle; 0 if they say nothing of it. */
static double fit_circle(const trial *t, const bool marked[LOWER_SLICES], double middle[2]) {
  double n = 0, mean[3] = {0}, xx = 0, xy = 0, yy = 0, xq = 0, yq = 0;
  for (int pass = 0; pass < 2; pass++)
    for (int64_t i = 0; i < t->near.count; i++) {
      const double *p = t->near.points[i], q = p[0] * p[0] + p[1] * p[1];
      const int s = slice_of(p[2]);
      if (s < 0 || s >= LOWER_SLICES || !marked[s] || q >= inner * inner)
        continue;
      if (!pass) {
        n++;
        pags_add3(mean, (const double[3]){p[0], p[1], q}, mean);
        continue;
      }
      const double x = p[0] - mean[0] / n, y = p[1] - mean[1] / n;
      xx += x * x;
      xy += x * y;
      yy += y * y;
      xq += x * (q - mean[2] / n);
      yq += y * (q - mean[2] / n);
    }
  const double det = xx * yy - xy * xy;
  if (!(det > 0.01 * xx * yy))
    return 0;
  middle[0] = 0.5 * (xq * yy - yq * xy) / det;
  middle[1] = 0.5 * (yq * xx - xq * xy) / det;
  return sqrt(fmax(0, mean[2] / n - 2 * (middle[0] * mean[0] + middle[1] * mean[1]) / n + middle[0] * middle[0] +
                          middle[1] * middle[1]));
}

/* The spread of a slice's points about the axis: the distance within which four fifths lie. */
static double slice_radius(trial *t, int s) {
  int64_t count = 0;
  for (int64_t i = 0; i < t->near.count; i++) {
    const double distance = pags_hypot(t->near.points[i][0], t->near.points[i][1]);
    if (slice_of(t->near.points[i][2]) == s && distance < inner)
      t->scratch[count++] = distance;
  }
  pags_sort_doubles(t->scratch, count);
  return count ? t->scratch[count * 4 / 5] : 0;
}

/* The median of the slices' values that are not NaN. */
static double median_of_slices(const double values[LOWER_SLICES]) {
  double list[LOWER_SLICES];
  int count = 0;
  for (int s = 0; s < LOWER_SLICES; s++)
    if (!isnan(values[s]))
      list[count++] = values[s];
  pags_sort_doubles(list, count);
  return list[count / 2];
}

/* How much of a column's radius the mean of its points lies before its axis: LiDAR sees the sides that face it. The
 * sensors are taken to be where the cameras are, and to hit the column in proportion to the inverse of their squared
 * distance. A side of a cylinder that is seen whole has its mean at pi / 4 of the radius. */
static void find_bias(const pags_depth_views *depth_views, const pags_column *c, double bias[2]) {
  double sum = 1e-9;
  bias[0] = bias[1] = 0;
  for (int64_t i = 0; i < depth_views->count; i++) {
    const double *pose = depth_views->list[i].camera.world_from_camera;
    const double to[2] = {pose[3] - c->foot[0], pose[7] - c->foot[1]}, distance = fmax(1, pags_hypot(to[0], to[1]));
    const double weight = 1 / (distance * distance);
    for (int k = 0; k < 2; k++)
      bias[k] += 0.785 * weight * to[k] / distance;
    sum += weight;
  }
  for (int k = 0; k < 2; k++)
    bias[k] /= sum;
}

/* Finds axis, radius and top of a column whose slices have been weighed about its foot. */
static void measure(const pags_depth_views *depth_views, trial *t, pags_column *c) {
  double values[LOWER_SLICES], offset[2], middle[2];
  bool marked[LOWER_SLICES];
  for (int k = 0; k < 2; k++)
    c->lean[k] = find_lean(t, k);
  for (int64_t i = 0; i < t->near.count; i++)
    for (int k = 0; k < 2; k++)
      t->near.points[i][k] -= c->lean[k] * t->near.points[i][2];
  for (int k = 0; k < 2; k++) {
    for (int s = 0; s < LOWER_SLICES; s++)
      values[s] = t->thin[s] ? median(t, s, k) : (double)NAN;
    offset[k] = median_of_slices(values);
  }
  for (int64_t i = 0; i < t->near.count; i++)
    for (int k = 0; k < 2; k++)
      t->near.points[i][k] -= offset[k];
  for (int s = 0; s < LOWER_SLICES; s++) {
    values[s] = t->thin[s] ? slice_radius(t, s) : (double)NAN;
    c->count += t->thin[s] ? t->on[s] : 0;
  }
  c->radius = median_of_slices(values);
  for (int s = 0; s < LOWER_SLICES; s++)
    marked[s] = values[s] < 1.5 * c->radius;
  const double radius = c->radius > 0.08 ? fit_circle(t, marked, middle) : 0;
  if (radius > 0.04 && radius < inner && pags_hypot(middle[0], middle[1]) < 0.2) {
    c->radius = radius;
  } else {
    find_bias(depth_views, c, middle);
    for (int k = 0; k < 2; k++)
      middle[k] *= -c->radius;
  }
  for (int k = 0; k < 2; k++)
    offset[k] += middle[k];
  c->radius = fmax(c->radius, least_radius);
  c->foot[0] += offset[0];
  c->foot[1] += offset[1];
  int top = 0;
  for (int s = 0, gap = 0; s < SLICES && gap <= MOST_GAP; s++) {
    gap = t->on[s] ? 0 : s > LOWER_SLICES ? gap + 1 : 0;
    if (s >= LOWER_SLICES && t->around[s] > 2 * t->on[s]) /* under a crown */
      break;
    if (t->on[s])
      top = s;
  }
  c->top = lowest + (top + 1) * slice;
}

/* Tries a column at a place. *found: it is one. */
static pags_result try_column(const pags_cloud *cloud, const pags_ground *ground, const pags_depth_views *depth_views,
                              const double place[2], trial *t, pags_column *c, bool *found) {
  const double distances[2] = {0, outer}, heights[2] = {lowest, highest};
  *c = (pags_column){.foot = {place[0], place[1], 0}};
  *found = false;
  if (!pags_ground_nearest(ground, place[0], place[1], &c->foot[2]))
    return PAGS_OK;
  for (int i = 0; i < 4; i++) { /* to the mean of the lower part's points within `inner` */
    double sum[3] = {0};
    PAGS_TRY(pags_cloud_near(cloud, c, (const double[2]){0, inner},
                             (const double[2]){lowest, lowest + LOWER_SLICES * slice}, &t->near));
    for (int64_t k = 0; k < t->near.count; k++)
      pags_add3(sum, t->near.points[k], sum);
    for (int k = 0; k < 2 && t->near.count; k++)
      c->foot[k] += sum[k] / (double)t->near.count;
  }
  PAGS_TRY(pags_cloud_near(cloud, c, distances, heights, &t->near));
  PAGS_CHECK_MEMORY(pags_grow(&t->scratch, t->near.count + 1, &t->room, sizeof *t->scratch), "a column's points");
  if (!weigh(t))
    return PAGS_OK;
  measure(depth_views, t, c);
  *found = pags_ground_nearest(ground, c->foot[0], c->foot[1], &c->foot[2]);
  return PAGS_OK;
}

pags_column_kind pags_column_kind_of(const pags_column *c, bool labelled) {
  const double pole = c->votes[PAGS_LABEL_POLE] + c->votes[PAGS_LABEL_LIGHT] + c->votes[PAGS_LABEL_SIGN];
  const double green = c->votes[PAGS_LABEL_VEGETATION];
  double sum = 0;
  for (int i = 0; i < PAGS_LABELS; i++)
    sum += c->votes[i];
  if (!(sum > 0)) /* by its shape */
    return c->top < 1.5    ? PAGS_COLUMN_OTHER
           : c->crown <= 1 ? PAGS_COLUMN_POLE
           : labelled      ? PAGS_COLUMN_OTHER
                           : PAGS_COLUMN_TRUNK;
  return pole >= least_share && pole >= green ? PAGS_COLUMN_POLE
         : green >= least_share               ? PAGS_COLUMN_TRUNK
                                              : PAGS_COLUMN_OTHER;
}

/* Moves a column's foot to the height of the points around it, which the ground may have missed behind a kerb. */
static pags_result find_foot(const pags_cloud *cloud, trial *t, pags_column *c) {
  PAGS_TRY(pags_cloud_near(cloud, c, (const double[2]){c->radius + ground_from, c->radius + ground_to},
                           (const double[2]){below, pavement}, &t->near));
  PAGS_CHECK_MEMORY(pags_grow(&t->scratch, t->near.count + 1, &t->room, sizeof *t->scratch), "a column's foot");
  for (int64_t i = 0; i < t->near.count; i++)
    t->scratch[i] = t->near.points[i][2];
  pags_sort_doubles(t->scratch, t->near.count);
  if (t->near.count >= LEAST_POINTS / 2) {
    c->foot[2] += t->scratch[t->near.count / 2];
    c->top -= t->scratch[t->near.count / 2];
  }
  return PAGS_OK;
}

/* Counts the points of a crown above a column, and lets the views label points on it, evenly chosen. */
static pags_result describe(const pags_cloud *cloud, const pags_depth_views *depth_views, trial *t, pags_column *c) {
  PAGS_TRY(find_foot(cloud, t, c));
  PAGS_TRY(pags_cloud_near(cloud, c, (const double[2]){inner, crown_reach}, (const double[2]){crown_foot, highest},
                           &t->near));
  c->crown = (double)t->near.count / (double)c->count;
  PAGS_TRY(pags_cloud_near(cloud, c, (const double[2]){0, inner},
                           (const double[2]){lowest, fmin(c->top, lowest + LOWER_SLICES * slice)}, &t->near));
  const int64_t step = t->near.count / MOST_VOTERS + 1;
  for (int64_t i = 0; i < t->near.count; i += step) {
    double p[3];
    pags_column_point(c, t->near.points[i][2], p);
    p[0] += t->near.points[i][0];
    p[1] += t->near.points[i][1];
    pags_labels_of_point(depth_views, p, c->votes);
  }
  pags_labels_share(c->votes);
  return PAGS_OK;
}

/* Adds a column, or replaces one with fewer points that stands where it does. */
static pags_result add(pags_columns *out, const pags_column *c) {
  for (int64_t i = 0; i < out->count; i++)
    if (pags_hypot(out->list[i].foot[0] - c->foot[0], out->list[i].foot[1] - c->foot[1]) < outer) {
      if (c->count > out->list[i].count)
        out->list[i] = *c;
      return PAGS_OK;
    }
  PAGS_CHECK_MEMORY(pags_grow(&out->list, out->count + 1, &out->capacity, sizeof *out->list), "columns");
  out->list[out->count++] = *c;
  return PAGS_OK;
}

pags_result pags_columns_find(const pags_cloud *cloud, const pags_ground *ground, const pags_depth_views *depth_views,
                              pags_columns *out) {
  PAGS_AUTO(forget_trial) trial t = {0};
  *out = (pags_columns){0};
  if (!cloud->first)
    return PAGS_OK;
  PAGS_AUTOFREE int32_t *low = calloc((size_t)(cloud->nx * cloud->ny), sizeof *low); /* points of the lower part */
  PAGS_CHECK_MEMORY(low, "%lld cells", (long long)(cloud->nx * cloud->ny));
  for (int64_t i = 0; i < cloud->nx * cloud->ny; i++)
    for (int64_t k = cloud->first[i]; k < cloud->first[i + 1]; k++)
      low[i] += (double)cloud->points[4 * k + 3] >= lowest &&
                (double)cloud->points[4 * k + 3] < lowest + LOWER_SLICES * slice;
  for (int64_t y = 1; y + 1 < cloud->ny; y++)
    for (int64_t x = 1; x + 1 < cloud->nx; x++) {
      const int64_t at = y * cloud->nx + x;
      int64_t sum = 0;
      bool peak = low[at] > 0, found;
      for (int64_t k = 0; k < 9 && peak; k++) {
        const int64_t other = at + (k / 3 - 1) * cloud->nx + k % 3 - 1;
        sum += low[other];
        peak = low[other] < low[at] || (low[other] == low[at] && other >= at);
      }
      if (!peak || sum < LEAST_POINTS)
        continue;
      const double place[2] = {cloud->x0 + ((double)x + 0.5) * cell, cloud->y0 + ((double)y + 0.5) * cell};
      pags_column c;
      PAGS_TRY(try_column(cloud, ground, depth_views, place, &t, &c, &found));
      if (found)
        PAGS_TRY(add(out, &c));
    }
  for (int64_t i = 0; i < out->count; i++)
    PAGS_TRY(describe(cloud, depth_views, &t, &out->list[i]));
  return PAGS_OK;
}
