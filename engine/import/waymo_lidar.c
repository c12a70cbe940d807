/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Waymo's range images to points (waymo_lidar.h). */
#include "import/waymo_lidar.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>

#include <pags/camera.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

#define PI 3.14159265358979323846

/* MOST_PIXELS: size limit of all range images of a frame together; Waymo's have 0.6 million pixels. */
enum { RANGE_DEPTH = 4, POSE_DEPTH = 6, MOST_PIXELS = 1 << 24 };

/* A LiDAR while its range images are decoded. */
typedef struct lidar {
  const char *where;
  char name[32];
  double vehicle_from_lidar[12];
  double frame_from_world[12];
  const Pags__Waymo__LaserCalibration *calibration;
  pags_waymo_matrix *poses; /* owned: pose of the vehicle at each pixel; NULL: the frame's own pose for all pixels */
  double *inclination;      /* cosine and sine of each row's inclination */
  double *azimuth;          /* cosine and sine of each column's azimuth */
  int rows, columns;        /* size of these arrays; 0: not made yet */
} lidar;

void pags_waymo_points_destroy(pags_waymo_points *points) {
  free(points->rows);
  *points = (pags_waymo_points){0};
}

/* ---- Directions of rows and columns ---- */

static void forget_angles(lidar *l) {
  free(l->inclination);
  free(l->azimuth);
  l->inclination = l->azimuth = NULL;
  l->rows = l->columns = 0;
}

static void destroy(lidar *l) {
  forget_angles(l);
  pags_waymo_free_matrix(l->poses);
}

/* Returns the inclination in radians of beam `i`, counted from the lowest. */
static double beam(const Pags__Waymo__LaserCalibration *c, int i, int rows) {
  if (c->n_beam_inclinations)
    return c->beam_inclinations[i];
  return c->beam_inclination_min + (i + 0.5) / rows * (c->beam_inclination_max - c->beam_inclination_min);
}

/* Computes the sines and cosines of the rows' inclinations and of the columns' azimuths (see waymo_lidar.h). */
static pags_result find_angles(lidar *l, int rows, int columns) {
  if (l->rows == rows && l->columns == columns)
    return PAGS_OK;
  forget_angles(l);
  const size_t beams = l->calibration->n_beam_inclinations;
  if (beams && beams != (size_t)rows)
    return pags_fail_at(l->where, "LiDAR %s has %zu beam inclinations, its range image %d rows", l->name, beams, rows);
  for (int i = 0; i < rows; i++)
    if (!isfinite(beam(l->calibration, i, rows)))
      return pags_fail_at(l->where, "LiDAR %s: beam inclination %d isn't finite", l->name, i);
  l->inclination = malloc((size_t)rows * 2 * sizeof *l->inclination);
  l->azimuth = malloc((size_t)columns * 2 * sizeof *l->azimuth);
  PAGS_CHECK_MEMORY(l->inclination && l->azimuth, "%s", l->where);
  for (int r = 0; r < rows; r++) {
    const double angle = beam(l->calibration, rows - 1 - r, rows);
    l->inclination[2 * r] = pags_cos(angle);
    l->inclination[2 * r + 1] = pags_sin(angle);
  }
  const double yaw = pags_atan2(l->vehicle_from_lidar[4], l->vehicle_from_lidar[0]);
  for (int c = 0; c < columns; c++) {
    const double angle = (1 - (2.0 * c + 1) / columns) * PI - yaw;
    l->azimuth[2 * c] = pags_cos(angle);
    l->azimuth[2 * c + 1] = pags_sin(angle);
  }
  l->rows = rows;
  l->columns = columns;
  return PAGS_OK;
}

/* ---- Range images to points ---- */

/* Converts a pixel of a range image to a point x y z intensity; returns false if the pixel has no return or if a
 * number is not finite. */
static bool decode_pixel(const lidar *l, const float *pixel, int64_t at, int row, int column, float out[4]) {
  const double range = (double)pixel[0];
  if (!(range > 0) || !isfinite(range) || !isfinite(pixel[1]))
    return false;
  const double flat = range * l->inclination[2 * row];
  const double seen[3] = {flat * l->azimuth[2 * column], flat * l->azimuth[2 * column + 1],
                          range * l->inclination[2 * row + 1]};
  double p[3];
  pags_rigid_point(l->vehicle_from_lidar, seen, p);
  if (l->poses) {
    const float *pose = l->poses->data + POSE_DEPTH * at; /* roll, pitch, yaw, x, y, z */
    double turn[3], place[3], world_from_pixel[12], world[3];
    pags_widen3(pose, turn);
    pags_widen3(pose + 3, place);
    pags_rigid_from_angles(turn, place, world_from_pixel);
    pags_rigid_point(world_from_pixel, p, world);
    pags_rigid_point(l->frame_from_world, world, p);
  }
  pags_narrow3(p, out);
  out[3] = pixel[1];
  return isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]);
}

static bool has_image(const Pags__Waymo__RangeImage *image) {
  return image && image->range_image_compressed.len;
}

static pags_result decode_return(lidar *l, const Pags__Waymo__RangeImage *image, pags_waymo_points *points) {
  if (!has_image(image))
    return PAGS_OK;
  char what[64];
  PAGS_AUTO(pags_waymo_free_matrix_auto) pags_waymo_matrix *matrix = NULL;
  snprintf(what, sizeof what, "range image of LiDAR %s", l->name);
  PAGS_TRY(pags_waymo_unpack_matrix(&image->range_image_compressed, RANGE_DEPTH, l->where, what, &matrix));
  const int rows = matrix->shape->dims[0], columns = matrix->shape->dims[1];
  if (l->poses && (l->poses->shape->dims[0] != rows || l->poses->shape->dims[1] != columns))
    return pags_fail_at(l->where, "LiDAR %s: poses of %d x %d pixels for a range image of %d x %d", l->name,
                        l->poses->shape->dims[0], l->poses->shape->dims[1], rows, columns);
  PAGS_TRY(find_angles(l, rows, columns));
  const int64_t needed = points->count + (int64_t)rows * columns; /* no overflow: a matrix has at most 2^24 values */
  if (needed > MOST_PIXELS)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: range images of more than %d pixels in all", l->where, MOST_PIXELS);
  PAGS_CHECK_MEMORY(
      pags_grow(&points->rows, needed, &points->capacity, PAGS_WAYMO_LIDAR_COLUMNS * sizeof *points->rows),
      "%s: %lld points", l->where, (long long)needed);
  for (int r = 0; r < rows; r++)
    for (int c = 0; c < columns; c++) {
      const int64_t at = (int64_t)r * columns + c;
      float *out = points->rows + PAGS_WAYMO_LIDAR_COLUMNS * points->count;
      points->count += decode_pixel(l, matrix->data + RANGE_DEPTH * at, at, r, c, out);
    }
  return PAGS_OK;
}

/* ---- The LiDARs of a frame ---- */

static pags_result begin_lidar(lidar *l, const pags_waymo_frame *frame, int name) {
  static const char *const names[] = {"TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR"};
  double world_from_frame[12];
  if (name >= 1 && name <= PAGS_WAYMO_LASERS)
    snprintf(l->name, sizeof l->name, "%s", names[name - 1]);
  else
    snprintf(l->name, sizeof l->name, "number %d", name);
  l->calibration = pags_waymo_lidar_calibration(frame, name);
  if (!l->calibration)
    return pags_fail_at(l->where, "LiDAR %s has a range image and no calibration", l->name);
  PAGS_TRY(pags_waymo_transform(l->calibration->extrinsic, l->where, "extrinsic of a LiDAR", l->vehicle_from_lidar));
  PAGS_TRY(pags_waymo_transform(frame->pose, l->where, "pose of the frame", world_from_frame));
  pags_rigid_inverse(world_from_frame, l->frame_from_world);
  return PAGS_OK;
}

pags_result pags_waymo_lidar_points(const pags_waymo_frame *frame, const char *where, pags_waymo_points *points) {
  assert(frame && where && points);
  for (size_t i = 0; i < frame->n_lasers; i++) {
    const Pags__Waymo__Laser *message = frame->lasers[i];
    const Pags__Waymo__RangeImage *first = message->ri_return1;
    if (!has_image(first) && !has_image(message->ri_return2))
      continue;
    PAGS_AUTO(destroy) lidar l = {.where = where};
    PAGS_TRY(begin_lidar(&l, frame, message->name));
    if (first && first->range_image_pose_compressed.len)
      PAGS_TRY(pags_waymo_unpack_matrix(&first->range_image_pose_compressed, POSE_DEPTH, where,
                                        "poses of a range image", &l.poses));
    PAGS_TRY(decode_return(&l, first, points));
    PAGS_TRY(decode_return(&l, message->ri_return2, points));
  }
  return PAGS_OK;
}
