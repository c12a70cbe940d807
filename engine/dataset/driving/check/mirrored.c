/* SPDX-License-Identifier: Apache-2.0 */
/* Tells by photographs and poses whether a recording is mirrored: with poses, sweeps and boxes in left-handed axes, as
 * CARLA and Unreal have them, all of it is consistent but for the photographs, which show the street the other way
 * round.
 *
 * The content of a patch of a photograph is found on its epipolar line in another one, which the camera took some
 * metres away. If the recording is mirrored, the line lies there for the mirrored motion of the camera. The two lines
 * are the same where a camera moves straight along its axis, and differ where it turns, by half a degree even, or looks
 * aside. For patches rich in contrast the best correlation on a line is taken; the mean over a pair of photographs is
 * 0.02 to 0.2 larger for the right motion in the recordings tried, and hardly ever smaller. The warning wants three
 * pairs in which the mirrored motion is better by 0.03, four times as many as the opposite, and 0.015 in the mean. */
#include "dataset/driving/check/looks.h"

#include "base/log.h"
#include "base/memory.h"
#include "dataset/driving/driving_set.h"

#include <math.h>
#include <stdlib.h>

enum {
  WIDTH = 240,
  LEAST_WIDTH = 150, /* pixels of a photograph: fewer don't show which side is which */
  ABOUT = 2,         /* pixels on each side of one that its mean is taken of */
  PATCH = 7,         /* pixels across */
  LEAST_PATCHES = 150,
  ENOUGH_PAIRS = 3, /* that tell */
  STEPS = 10,       /* of a camera, from all over the recording */
  MOST_PAIRS = 15,
  MOST_CAMERAS = 6
};

static const double least_way = 1.5, best_way = 4, farthest_way = 8; /* metres between two photographs */
static const double telling = 0.03, least_gain = 0.015; /* of the correlations: of a pair that tells, of the mean */

/* A small photograph without its low frequencies. */
typedef struct plane {
  int64_t view;
  int width, height;
  double step;
  float *detail;
} plane;

static pags_result make_plane(const pags_dataset *dataset, int64_t view, plane *out) {
  PAGS_AUTO(pags_image_destroy) pags_image grey = {0};
  PAGS_TRY(pags_small_photo_load(dataset, view, WIDTH, &grey, &out->step));
  out->view = view;
  out->width = grey.width;
  out->height = grey.height;
  out->detail = malloc((size_t)grey.width * (size_t)grey.height * sizeof *out->detail);
  PAGS_CHECK_MEMORY(out->detail, "%s", dataset->views[view].image_path);
  const uint8_t *data = grey.data;
  for (int y = 0; y < grey.height; y++)
    for (int x = 0; x < grey.width; x++) {
      int sum = 0, count = 0;
      for (int j = y > ABOUT ? y - ABOUT : 0; j <= y + ABOUT && j < grey.height; j++)
        for (int i = x > ABOUT ? x - ABOUT : 0; i <= x + ABOUT && i < grey.width; i++, count++)
          sum += data[j * grey.width + i];
      out->detail[y * grey.width + x] = (float)data[y * grey.width + x] - (float)sum / (float)count;
    }
  return PAGS_OK;
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

/* The pixels about one, without their mean; returns the root of the sum of their squares. */
static double patch(const plane *from, int x, int y, float out[PATCH * PATCH]) {
  double sum = 0, square = 0;
  for (int k = 0; k < PATCH * PATCH; k++) {
    out[k] = from->detail[(y + k / PATCH - PATCH / 2) * from->width + x + k % PATCH - PATCH / 2];
    sum += (double)out[k] / (PATCH * PATCH);
  }
  for (int k = 0; k < PATCH * PATCH; k++) {
    out[k] -= (float)sum;
    square += (double)out[k] * (double)out[k];
  }
  return sqrt(square);
}

static bool direction_of(const pags_dataset *dataset, const plane *from, double x, double y, double out[3]) {
  const pags_camera *camera = &dataset->cameras[from->view];
  if (pags_camera_bends(camera))
    return pags_camera_look(camera, x * from->step, y * from->step, out);
  out[2] = 1;
  return pags_lens_unproject(&dataset->parsed.views[from->view].lens, x * from->step, y * from->step, &out[0], &out[1]);
}

/* The best correlation of a patch of the first photograph with those of the second on its epipolar line, at some
 * depths; `side` -1: mirrored. -1 if the line is outside. */
static double best_match(const pags_dataset *dataset, const plane pair[2], const double b_from_a[12],
                         const double direction[3], double side, const float *wanted, double norm) {
  static const double depths[] = {4, 6, 8, 11, 15, 20, 28, 40, 60, 100, 1000}; /* metres */
  double best = -1;
  for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
    const double p[3] = {side * direction[0] * depths[i], direction[1] * depths[i], direction[2] * depths[i]};
    double q[3], at[2];
    float found[PATCH * PATCH];
    pags_rigid_point(b_from_a, p, q);
    q[0] *= side;
    if (!see(dataset, &pair[1], q, at))
      continue;
    const int x = (int)at[0], y = (int)at[1];
    if (x < PATCH / 2 || y < PATCH / 2 || x >= pair[1].width - PATCH / 2 || y >= pair[1].height - PATCH / 2)
      continue;
    const double other = patch(&pair[1], x, y, found);
    double product = 0;
    for (int k = 0; k < PATCH * PATCH; k++)
      product += (double)wanted[k] * (double)found[k];
    best = other > 0 ? fmax(best, product / (norm * other)) : best;
  }
  return best;
}

/* Compares the photographs of a pair by the patches of more than the mean contrast: each is found somewhere on its
 * epipolar line if the motion of the camera is right, and only at random on that of the mirrored motion. */
static int64_t compare_patches(const pags_dataset *dataset, const plane pair[2], double *read, double *flipped) {
  double to[12], b_from_a[12], mean = 0;
  int64_t count = 0, all = 0;
  float wanted[PATCH * PATCH];
  pags_rigid_inverse(dataset->views[pair[1].view].camera.world_from_camera, to);
  pags_rigid_multiply(to, dataset->views[pair[0].view].camera.world_from_camera, b_from_a);
  for (int pass = 0; pass < 2; pass++)
    for (int y = PATCH; y < pair[0].height - PATCH; y += PATCH - 2)
      for (int x = PATCH; x < pair[0].width - PATCH; x += PATCH - 2) {
        const double norm = patch(&pair[0], x, y, wanted);
        double direction[3];
        mean += pass ? 0 : norm;
        all += !pass;
        if (!pass || !(norm * (double)all > mean) || !direction_of(dataset, &pair[0], x + 0.5, y + 0.5, direction))
          continue;
        const double a = best_match(dataset, pair, b_from_a, direction, 1, wanted, norm);
        const double b = best_match(dataset, pair, b_from_a, direction, -1, wanted, norm);
        if (a > -1 && b > -1) {
          *read += a;
          *flipped += b;
          count++;
        }
      }
  *read /= (double)(count ? count : 1);
  *flipped /= (double)(count ? count : 1);
  return count;
}

/* ---- Pairs of photographs ---- */

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

/* What the pairs said. */
typedef struct verdict {
  int pairs, upright, mirrored; /* of all pairs those that tell */
  double as_read, flipped;      /* sums of the correlations */
} verdict;

static void destroy_pair(plane (*pair)[2]) {
  free((*pair)[0].detail);
  free((*pair)[1].detail);
}

static pags_result look_at_pair(const pags_dataset *dataset, int64_t view, verdict *v) {
  const int64_t partner = find_partner(dataset, view);
  double read = 0, flipped = 0;
  if (partner < 0 || dataset->parsed.views[view].lens.width < LEAST_WIDTH)
    return PAGS_OK;
  PAGS_AUTO(destroy_pair) plane pair[2] = {0};
  PAGS_TRY(make_plane(dataset, view, &pair[0]));
  PAGS_TRY(make_plane(dataset, partner, &pair[1]));
  if (compare_patches(dataset, pair, &read, &flipped) < LEAST_PATCHES)
    return PAGS_OK;
  v->pairs++;
  v->mirrored += flipped - read > telling;
  v->upright += read - flipped > telling;
  v->as_read += read;
  v->flipped += flipped;
  return PAGS_OK;
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
  verdict v = {0};
  for (int s = 0; s < STEPS; s++)
    for (int64_t c = 0; c < driving->sensor_count && c < MOST_CAMERAS; c++) {
      const int64_t view = choose_view(dataset, driving->sensors[c].number, order[s]);
      const bool clear = v.pairs >= ENOUGH_PAIRS && v.mirrored == 0 && v.as_read - v.flipped > least_gain * v.pairs;
      if (view >= 0 && !clear && v.pairs < MOST_PAIRS)
        PAGS_TRY(look_at_pair(dataset, view, &v));
    }
  if (v.mirrored >= ENOUGH_PAIRS && v.mirrored >= 4 * v.upright && v.flipped - v.as_read > least_gain * v.pairs)
    PAGS_WARN(
        "%s: %d of %d pairs of photographs fit their cameras' poses better mirrored (correlation %.2f, as read %.2f): "
        "axes look left-handed, as CARLA's and Unreal's are, or photographs mirrored; expected right-handed axes: "
        "negate y of poses, sweeps and boxes before converting",
        driving->root, v.mirrored, v.pairs, v.flipped / v.pairs, v.as_read / v.pairs);
  return PAGS_OK;
}
