/* SPDX-License-Identifier: Apache-2.0 */
/* Tells by LiDAR points and photographs whether a recording is mirrored: with poses, sweeps and boxes in left-handed
 * axes, as CARLA and Unreal have them, all of it is consistent but for the photographs, which show the street the other
 * way round.
 *
 * A point of a sweep looks alike in two photographs that a camera took some metres apart, if both show it where its
 * coordinates say: the grey at it, without the mean about it, is correlated. If the recording is mirrored, the
 * photographs show it in the same row on the other side of the camera's axis, and the correlation is found there. In
 * the recordings tried it is 0.2 to 0.5 on the right side and -0.1 to 0.15 on the other, on average; of single pairs in
 * twenty one is wrong by the 0.15 that tell, where both sides of a street look alike. The warning wants three pairs
 * that tell, four times as many as tell the opposite. */
#include "dataset/driving/looks.h"

#include "base/log.h"
#include "base/memory.h"
#include "dataset/driving/driving_set.h"
#include "dataset/driving/reader.h"
#include "dataset/driving/small_photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
  WIDTH = 240,
  LEAST_WIDTH = 150, /* pixels of a photograph: fewer don't show which side is which */
  ABOUT = 2,         /* pixels on each side of one that its mean is taken of */
  MOST_POINTS = 6000,
  LEAST_POINTS = 150, /* that both photographs of a pair show */
  ENOUGH_PAIRS = 3,   /* that tell */
  CELL = 3,
  MOST_HEIGHT = 480, /* pixels */
  STEPS = 10,        /* of a camera, from all over the recording */
  MOST_PAIRS = 15,
  MOST_CAMERAS = 6
};

static const double least_way = 1.5, best_way = 4, farthest_way = 8; /* metres between two photographs */
static const double reach = 40, least_shift = 1.5; /* metres of points, pixels that they move between the photographs */
/* Of the correlations: a difference that tells, the least mean of all differences, and of those mirrored. */
static const double telling = 0.15, least_gain = 0.1, least_share = 0.15;

/* A small photograph without its low frequencies. */
typedef struct plane {
  int64_t view;
  int width, height;
  double step;
  float *detail;
} plane;

static pags_result make_plane(const pags_dataset *dataset, int64_t view, plane *out) {
  pags_image grey;
  PAGS_TRY(pags_small_photo_load(dataset, view, WIDTH, &grey, &out->step));
  out->view = view;
  out->width = grey.width;
  out->height = grey.height;
  out->detail = malloc((size_t)grey.width * (size_t)grey.height * sizeof *out->detail);
  const uint8_t *data = grey.data;
  for (int y = 0; out->detail && y < grey.height; y++)
    for (int x = 0; x < grey.width; x++) {
      int sum = 0, count = 0;
      for (int j = y > ABOUT ? y - ABOUT : 0; j <= y + ABOUT && j < grey.height; j++)
        for (int i = x > ABOUT ? x - ABOUT : 0; i <= x + ABOUT && i < grey.width; i++, count++)
          sum += data[j * grey.width + i];
      out->detail[y * grey.width + x] = (float)data[y * grey.width + x] - (float)sum / (float)count;
    }
  pags_image_destroy(&grey);
  return out->detail ? PAGS_OK : pags_out_of_memory("%s", dataset->views[view].image_path);
}

/* Where the photograph shows a point of the camera's frame, in pixels of the small one; false: nowhere. */
static bool see(const pags_dataset *dataset, const plane *from, const double point[3], double pixel[2]) {
  const pags_camera *camera = &dataset->cameras[from->view];
  if (pags_camera_bends(camera)) {
    if (!pags_camera_project(camera, point, pixel, NULL))
      return false;
  } else if (!(point[2] > 0.5) || !pags_lens_project(&dataset->parsed.views[from->view].lens, point[0] / point[2],
                                                     point[1] / point[2], &pixel[0], &pixel[1])) {
    return false;
  }
  pixel[0] /= from->step;
  pixel[1] /= from->step;
  return pixel[0] > 1 && pixel[1] > 1 && pixel[0] < from->width - 1 && pixel[1] < from->height - 1;
}

static double detail_at(const plane *from, const double pixel[2]) {
  const int x = (int)floor(pixel[0] - 0.5), y = (int)floor(pixel[1] - 0.5);
  const double u = pixel[0] - 0.5 - x, v = pixel[1] - 0.5 - y;
  const float *d = from->detail + y * from->width + x;
  return (1 - v) * ((1 - u) * (double)d[0] + u * (double)d[1]) +
         v * ((1 - u) * (double)d[from->width] + u * (double)d[from->width + 1]);
}

/* A point that both photographs of a pair show, as read and mirrored: its pixels and its depth in the first. */
typedef struct sight {
  double at[2][2][2];  /* as read or mirrored, photograph, x and y */
  double depth, shift; /* shift: pixels between the photographs, as read */
} sight;

/* Fills in a sight; returns whether both photographs show the point, both ways, and at places so far apart. */
static bool sight_of(const pags_dataset *dataset, const plane pair[2], const double world[3], sight *out) {
  for (int k = 0; k < 2; k++) {
    double to[12], p[3];
    pags_rigid_inverse(dataset->views[pair[k].view].camera.world_from_camera, to);
    pags_rigid_point(to, world, p);
    const double depth = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    const double other[3] = {-p[0], p[1], p[2]};
    if (depth > reach || !see(dataset, &pair[k], p, out->at[0][k]) || !see(dataset, &pair[k], other, out->at[1][k]))
      return false;
    out->depth = k ? out->depth : depth;
  }
  out->shift = hypot(out->at[0][0][0] - out->at[0][1][0], out->at[0][0][1] - out->at[0][1][1]);
  return out->shift >= least_shift;
}

static int64_t cell_of(const double at[2]) {
  return (int64_t)(at[1] / CELL) * (WIDTH / CELL + 1) + (int64_t)(at[0] / CELL);
}

/* Keeps the sights on whose mirrored side the first photograph shows something that moves by other pixels, as its depth
 * is another, or nothing: what is the same on both sides, as a road is, doesn't tell them apart. Returns how many are
 * left. */
static int64_t keep_uneven(sight *sights, int64_t count, float *depths, int64_t cells) {
  int64_t kept = 0;
  for (int64_t c = 0; c < cells; c++)
    depths[c] = INFINITY;
  for (int64_t i = 0; i < count; i++) {
    float *depth = &depths[cell_of(sights[i].at[0][0])];
    *depth = fminf(*depth, (float)sights[i].depth);
  }
  for (int64_t i = 0; i < count; i++) {
    const double other = (double)depths[cell_of(sights[i].at[1][0])];
    if (sights[i].shift * fabs(1 - sights[i].depth / other) >= least_shift)
      sights[kept++] = sights[i];
  }
  return kept;
}

/* Correlation of the details of two photographs at the sights, as read (0) or mirrored (1). */
static double correlation(const plane pair[2], const sight *sights, int64_t count, int side) {
  double sum[2] = {0}, square[2] = {0}, product = 0;
  const double n = (double)count;
  for (int64_t i = 0; i < count; i++) {
    const double a = detail_at(&pair[0], sights[i].at[side][0]), b = detail_at(&pair[1], sights[i].at[side][1]);
    sum[0] += a;
    sum[1] += b;
    square[0] += a * a;
    square[1] += b * b;
    product += a * b;
  }
  const double var_a = square[0] - sum[0] * sum[0] / n, var_b = square[1] - sum[1] * sum[1] / n;
  return var_a > 0 && var_b > 0 ? (product - sum[0] * sum[1] / n) / sqrt(var_a * var_b) : 0;
}

/* Takes at most MOST_POINTS points of the sweep of a time step to the world; *count 0: it has none. */
static pags_result take_points(const pags_driving *driving, int frame, int64_t *count, double (*points)[3]) {
  int64_t sweep = 0, all;
  float *xyz;
  *count = 0;
  while (sweep < driving->sweep_count && driving->sweeps[sweep].frame != frame)
    sweep++;
  if (sweep == driving->sweep_count)
    return PAGS_OK;
  PAGS_TRY(pags_sweep_read(driving, sweep, &all, &xyz, NULL));
  for (int64_t i = 0; i < all; i += 1 + all / MOST_POINTS) {
    const double p[3] = {(double)xyz[3 * i], (double)xyz[3 * i + 1], (double)xyz[3 * i + 2]};
    pags_rigid_point(driving->sweeps[sweep].world_from_sweep, p, points[*count]);
    ++*count;
  }
  free(xyz);
  return PAGS_OK;
}

/* Finds the view of the same camera that is nearest to best_way from this one; -1: none is near. */
static int64_t find_partner(const pags_dataset *dataset, int64_t view) {
  int64_t best = -1;
  double nearest = (double)INFINITY;
  for (int64_t i = 0; i < dataset->count; i++) {
    const double way = pags_view_distance(dataset, view, i);
    if (dataset->views[i].sensor != dataset->views[view].sensor || way < least_way || way > farthest_way ||
        fabs(way - best_way) >= nearest)
      continue;
    nearest = fabs(way - best_way);
    best = i;
  }
  return best;
}

/* Room for one pair, and what the pairs said. */
typedef struct verdict {
  double points[MOST_POINTS][3];
  sight sights[MOST_POINTS];
  float depths[(WIDTH / CELL + 1) * (MOST_HEIGHT / CELL + 1)];
  int pairs, upright, mirrored; /* of all pairs those that tell */
  double as_read, flipped;      /* sums of the correlations */
} verdict;

static pags_result compare(const pags_dataset *dataset, const plane pair[2], int64_t count, verdict *v) {
  int64_t shown = 0;
  for (int64_t i = 0; i < count && pair[0].height <= MOST_HEIGHT; i++)
    shown += sight_of(dataset, pair, v->points[i], &v->sights[shown]);
  shown = keep_uneven(v->sights, shown, v->depths, (int64_t)(sizeof v->depths / sizeof *v->depths));
  if (shown < LEAST_POINTS)
    return PAGS_OK;
  const double read = correlation(pair, v->sights, shown, 0), flipped = correlation(pair, v->sights, shown, 1);
  v->pairs++;
  v->mirrored += flipped - read > telling;
  v->upright += read - flipped > telling;
  v->as_read += read;
  v->flipped += flipped;
  return PAGS_OK;
}

static pags_result look_at_pair(const pags_dataset *dataset, int64_t view, verdict *v) {
  const int64_t partner = find_partner(dataset, view);
  int64_t count = 0;
  plane pair[2] = {0};
  if (partner < 0 || dataset->parsed.views[view].lens.width < LEAST_WIDTH)
    return PAGS_OK;
  PAGS_TRY(take_points(dataset->parsed.driving, dataset->views[view].frame, &count, v->points));
  if (count == 0)
    return PAGS_OK;
  pags_result result = make_plane(dataset, view, &pair[0]);
  if (result == PAGS_OK)
    result = make_plane(dataset, partner, &pair[1]);
  if (result == PAGS_OK)
    result = compare(dataset, pair, count, v);
  free(pair[0].detail);
  free(pair[1].detail);
  return result;
}

/* The view of a camera at the `step`-th of STEPS time steps spread over the recording that has a sweep and a
 * photograph.
 */
static int64_t choose_view(const pags_dataset *dataset, int sensor, int step) {
  int64_t count = 0;
  for (int64_t i = 0; i < dataset->count; i++)
    count += dataset->views[i].sensor == sensor;
  int64_t wanted = count * (2 * step + 1) / (2 * STEPS);
  for (int64_t i = 0; i < dataset->count; i++)
    if (dataset->views[i].sensor == sensor && wanted-- == 0)
      return i;
  return -1;
}

pags_result pags_look_for_mirror(const pags_dataset *dataset) {
  static const int order[STEPS] = {5, 0, 9, 2, 7, 4, 1, 8, 3, 6};
  const pags_driving *driving = dataset->parsed.driving;
  pags_result result = PAGS_OK;
  if (driving->sweep_count == 0)
    return PAGS_OK;
  verdict *v = calloc(1, sizeof *v);
  if (!v)
    return pags_out_of_memory("%s", driving->root);
  for (int s = 0; s < STEPS; s++)
    for (int64_t c = 0; c < driving->sensor_count && c < MOST_CAMERAS && result == PAGS_OK; c++) {
      const int64_t view = choose_view(dataset, driving->sensors[c].number, order[s]);
      const bool clear =
          v->pairs >= ENOUGH_PAIRS && v->mirrored == 0 && v->as_read - v->flipped > least_gain * v->pairs;
      if (view >= 0 && !clear && v->pairs < MOST_PAIRS)
        result = look_at_pair(dataset, view, v);
    }
  if (result == PAGS_OK && v->mirrored >= ENOUGH_PAIRS && v->mirrored >= 4 * v->upright &&
      v->flipped - v->as_read > least_gain * v->pairs && v->flipped > least_share * v->pairs)
    pags_log_message(
        PAGS_LOG_WARNING,
        "%s: LiDAR points fit %d of %d pairs of photographs better mirrored (correlation %.2f, as read "
        "%.2f): its axes look left-handed, as CARLA's and Unreal's are, or its photographs mirrored; expected "
        "right-handed axes: negate y of poses, sweeps and boxes before converting",
        driving->root, v->mirrored, v->pairs, v->flipped / v->pairs, v->as_read / v->pairs);
  free(v);
  return result;
}
