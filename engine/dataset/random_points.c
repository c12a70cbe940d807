/* Random points to start from where a data set has none.
 *
 * A uniform cube would put most of them where no camera looks, or right in front of one. Ours are drawn along the cameras'
 * own rays: a random training view, a random pixel of it, a random depth; those that too few other views see are drawn
 * again. Depth is spread evenly in its logarithm, so that the density falls with distance as the size of a pixel in
 * space grows, around the depth of the subject: the point nearest to all optical axes. */
#include "dataset/draft.h"

#include "base/rng.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

/* Depths drawn, as multiples of the subject's. Measured on a COLMAP model of an object in a room (data/fox): of the
 * observations 98 % lie within. */
#define NEAREST 0.45
#define FARTHEST 4.0

enum { DRAW_VIEW, DRAW_PIXEL, DRAW_DEPTH, DRAW_COLOUR };

/* What the draws of a seed are for; other users of the same seed take other streams. */
#define STREAM UINT64_C(0x706f696e74730000)

static int by_value(const void *a, const void *b) {
  double left = *(const double *)a, right = *(const double *)b;
  return left < right ? -1 : left > right;
}

/* Solves the symmetric 3x3 system a x = b; false where it is close to singular. */
static bool solve(const double a[6], const double b[3], double x[3]) {
  double xx = a[0], xy = a[1], xz = a[2], yy = a[3], yz = a[4], zz = a[5];
  double c0 = yy * zz - yz * yz, c1 = xz * yz - xy * zz, c2 = xy * yz - xz * yy;
  double det = xx * c0 + xy * c1 + xz * c2, trace = xx + yy + zz;
  if (!(det > 1e-6 * trace * trace * trace))
    return false;
  x[0] = (c0 * b[0] + c1 * b[1] + c2 * b[2]) / det;
  x[1] = (c1 * b[0] + (xx * zz - xz * xz) * b[1] + (xy * xz - xx * yz) * b[2]) / det;
  x[2] = (c2 * b[0] + (xy * xz - xx * yz) * b[1] + (xx * yy - xy * xy) * b[2]) / det;
  return true;
}

static void centre_of(const pags_camera *camera, double c[3]) {
  for (int i = 0; i < 3; i++)
    c[i] = camera->world_from_camera[4 * i + 3];
}

/* The point with the smallest sum of squared distances from all optical axes: sum of (I - d d^T)(x - c) = 0. Relative to
 * `middle`, so that large coordinates cancel nothing. */
static bool find_subject(const pags_camera *const *cameras, int64_t count, const double middle[3], double subject[3]) {
  double a[6] = {0}, b[3] = {0};
  for (int64_t i = 0; i < count; i++) {
    const double *m = cameras[i]->world_from_camera;
    double d[3] = {m[2], m[6], m[10]}, c[3];
    for (int j = 0; j < 3; j++)
      c[j] = m[4 * j + 3] - middle[j];
    double along = d[0] * c[0] + d[1] * c[1] + d[2] * c[2];
    a[0] += 1 - d[0] * d[0];
    a[1] -= d[0] * d[1];
    a[2] -= d[0] * d[2];
    a[3] += 1 - d[1] * d[1];
    a[4] -= d[1] * d[2];
    a[5] += 1 - d[2] * d[2];
    for (int j = 0; j < 3; j++)
      b[j] += c[j] - along * d[j];
  }
  if (!solve(a, b, subject))
    return false;
  for (int j = 0; j < 3; j++)
    subject[j] += middle[j];
  return true;
}

static double depth_of(const pags_camera *camera, const double point[3]) {
  const double *m = camera->world_from_camera;
  return m[2] * (point[0] - m[3]) + m[6] * (point[1] - m[7]) + m[10] * (point[2] - m[11]);
}

/* Root mean square distance of the cameras from their middle. */
static double find_middle(const pags_camera *const *cameras, int64_t count, double middle[3]) {
  double square = 0, c[3];
  for (int j = 0; j < 3; j++)
    middle[j] = 0;
  for (int64_t i = 0; i < count; i++) {
    centre_of(cameras[i], c);
    for (int j = 0; j < 3; j++)
      middle[j] += c[j] / (double)count;
  }
  for (int64_t i = 0; i < count; i++) {
    centre_of(cameras[i], c);
    for (int j = 0; j < 3; j++)
      square += (c[j] - middle[j]) * (c[j] - middle[j]);
  }
  return sqrt(square / (double)count);
}

/* The distance at which things are: the median depth of the subject. Cameras that have no subject in common (they look
 * ahead, or outward) say nothing but how far they are apart; one camera alone, nothing at all. */
static pags_result find_distance(const pags_camera *const *cameras, int64_t count, double *out) {
  double middle[3], subject[3], spread = find_middle(cameras, count, middle);
  *out = spread > 1e-9 ? 4 * spread : 1;
  if (!find_subject(cameras, count, middle, subject))
    return PAGS_OK;
  double *depths = malloc((size_t)count * sizeof *depths);
  if (!depths)
    return pags_draft_memory("random points");
  int64_t ahead = 0;
  for (int64_t i = 0; i < count; i++) {
    depths[ahead] = depth_of(cameras[i], subject);
    ahead += depths[ahead] > 0;
  }
  qsort(depths, (size_t)ahead, sizeof *depths, by_value);
  if (2 * ahead > count && depths[ahead / 2] < 20 * spread)
    *out = depths[ahead / 2];
  free(depths);
  return PAGS_OK;
}

static bool sees(const pags_camera *camera, const double point[3], double nearest) {
  const double *m = camera->world_from_camera;
  double p[3] = {point[0] - m[3], point[1] - m[7], point[2] - m[11]};
  double z = m[2] * p[0] + m[6] * p[1] + m[10] * p[2];
  if (!(z >= nearest))
    return false;
  double u = camera->fx * (m[0] * p[0] + m[4] * p[1] + m[8] * p[2]) / z + camera->cx;
  double v = camera->fy * (m[1] * p[0] + m[5] * p[1] + m[9] * p[2]) / z + camera->cy;
  return u >= 0 && u <= camera->width && v >= 0 && v <= camera->height;
}

static bool seen_by(const pags_camera *const *cameras, int64_t count, const double point[3], double nearest,
                    int64_t enough) {
  for (int64_t i = 0; i < count && enough > 0; i++)
    enough -= sees(cameras[i], point, nearest);
  return enough <= 0;
}

static void draw_point(const pags_camera *const *cameras, int64_t count, double distance, uint64_t seed, uint64_t draw,
                       double point[3]) {
  const pags_camera *camera = cameras[pags_rng_below(seed, STREAM + DRAW_VIEW, draw, (uint64_t)count)];
  const double *m = camera->world_from_camera;
  double pixel[2];
  pags_rng_uniform2(seed, STREAM + DRAW_PIXEL, draw, pixel);
  double z = NEAREST * distance * pow(FARTHEST / NEAREST, pags_rng_uniform(seed, STREAM + DRAW_DEPTH, draw));
  double x = (pixel[0] * camera->width - camera->cx) / camera->fx * z;
  double y = (pixel[1] * camera->height - camera->cy) / camera->fy * z;
  for (int i = 0; i < 3; i++)
    point[i] = m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] * z + m[4 * i + 3];
}

pags_result pags_random_points(const pags_camera *const *cameras, int64_t camera_count, const double origin[3],
                               uint64_t seed, int64_t count, float *xyz, uint8_t *rgb) {
  assert(camera_count > 0 && count > 0);
  double distance;
  PAGS_TRY(find_distance(cameras, camera_count, &distance));
  /* Three views place a point; sets of fewer can't ask for more than they have. After enough misses any point will do:
   * views that overlap with nothing still need something to start from. */
  int64_t enough = camera_count < 3 ? camera_count : 3, misses = 0;
  uint64_t draw = 0;
  for (int64_t i = 0; i < count;) {
    double point[3];
    draw_point(cameras, camera_count, distance, seed, draw++, point);
    if (misses < 16 * count && !seen_by(cameras, camera_count, point, 0.5 * NEAREST * distance, enough)) {
      misses++;
      continue;
    }
    uint32_t colour[4];
    pags_rng_u32x4(seed, STREAM + DRAW_COLOUR, (uint64_t)i, colour);
    for (int c = 0; c < 3; c++) {
      xyz[3 * i + c] = (float)(point[c] - origin[c]);
      rgb[3 * i + c] = (uint8_t)(96 + colour[c] % 64);
    }
    i++;
  }
  return PAGS_OK;
}
