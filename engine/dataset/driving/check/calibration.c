/* SPDX-License-Identifier: Apache-2.0 */
/* Compares calibration, poses and photographs of a driving set: one size a camera, a principal point near the middle,
 * a focal length in pixels, cameras that stand upright. */
#include "dataset/driving/check/checks.h"

#include "base/file.h"
#include "base/log.h"
#include "base/vec3.h"

#include <pags/camera.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- Sizes of photographs ---- */

static bool is_seen_by(const pags_parsed_view *view, const pags_sensor *sensor) {
  return !view->missing && view->sensor == sensor->number;
}

static bool same_size(const pags_parsed_view *a, const pags_parsed_view *b) {
  return a->lens.width == b->lens.width && a->lens.height == b->lens.height;
}

/* Returns the first photograph of the camera, or the first of another size than `usual` has; NULL: not found. */
static const pags_parsed_view *find_view(const pags_parsed_dataset *parsed, const pags_sensor *sensor,
                                         const pags_parsed_view *usual) {
  for (int64_t i = 0; i < parsed->count; i++)
    if (is_seen_by(&parsed->views[i], sensor) && (!usual || !same_size(&parsed->views[i], usual)))
      return &parsed->views[i];
  return NULL;
}

static int64_t count_like(const pags_parsed_dataset *parsed, const pags_sensor *sensor, const pags_parsed_view *view) {
  int64_t count = 0;
  for (int64_t i = 0; i < parsed->count; i++)
    count += is_seen_by(&parsed->views[i], sensor) && same_size(&parsed->views[i], view);
  return count;
}

/* A camera has one calibration, so its photographs have one size. */
static pags_result check_sizes(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const pags_sensor *sensor = &driving->sensors[i];
    const pags_parsed_view *usual = find_view(parsed, sensor, NULL);
    const pags_parsed_view *odd = usual ? find_view(parsed, sensor, usual) : NULL;
    if (!odd)
      continue;
    if (count_like(parsed, sensor, odd) > count_like(parsed, sensor, usual)) {
      const pags_parsed_view *other = odd;
      odd = usual;
      usual = other;
    }
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: %d x %d pixels, expected %d x %d as %lld photographs of camera %d have (%s): it has one "
                     "calibration, intrinsics/%d.txt",
                     odd->image_path, odd->lens.width, odd->lens.height, usual->lens.width, usual->lens.height,
                     (long long)count_like(parsed, sensor, usual), sensor->number, pags_path_name(usual->image_path),
                     sensor->number);
  }
  return PAGS_OK;
}

/* ---- Intrinsics ---- */

/* Shares of the picture's side: the least focal length of a pinhole camera (157 degrees); how far the principal point
 * lies from the middle before it is reported, and before another size of the picture is looked for. */
static const double least_focal = 0.1, most_focal = 30, far_off = 0.3, off = 0.06;

/* Whether the principal point is the middle of a picture of another size. */
static bool is_of_another_size(const pags_lens *lens) {
  const double x = 2 * lens->cx / lens->width, y = 2 * lens->cy / lens->height;
  const double scale = 0.5 * (x + y); /* that size by this one's */
  return fabs(x - 1) > 2 * off && fabs(y - 1) > 2 * off && fabs(x - y) < 0.06 * scale && scale > 0;
}

static pags_result check_lenses(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  int resized = 0, aside = 0, stretched = 0, total = 0;
  const pags_parsed_view *first_resized = NULL, *first_aside = NULL, *first_stretched = NULL;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const pags_sensor *sensor = &driving->sensors[i];
    const pags_parsed_view *view = find_view(parsed, sensor, NULL);
    if (!view)
      continue;
    const pags_lens *lens = &view->lens;
    const double x = lens->fx / lens->width, y = lens->fy / lens->height;
    total++;
    if (x < least_focal || y < least_focal || x > most_focal || y > most_focal)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s/intrinsics/%d.txt:1: focal lengths %g and %g, expected pixels: %g to %g times the size of "
                       "the photographs, %d x %d (%s)%s",
                       driving->root, sensor->number, lens->fx, lens->fy, least_focal, most_focal, lens->width,
                       lens->height, pags_path_name(view->image_path),
                       lens->cx <= 1 && lens->cy <= 1 && lens->fx < 10
                           ? "; values divided by the picture's size are to be multiplied by it"
                           : "");
    if (is_of_another_size(lens))
      first_resized = resized++ ? first_resized : view;
    else if (fabs(lens->cx / lens->width - 0.5) > far_off || fabs(lens->cy / lens->height - 0.5) > far_off)
      first_aside = aside++ ? first_aside : view;
    if (lens->fx > 1.25 * lens->fy || lens->fy > 1.25 * lens->fx)
      first_stretched = stretched++ ? first_stretched : view;
  }

  if (resized > 0) {
    const pags_lens *lens = &first_resized->lens;
    PAGS_WARN(
        "%s/intrinsics: %d of %d cameras have intrinsics of photographs of another size: the principal point of camera "
        "%d, %g %g, is the middle of about %.0f x %.0f pixels, its photographs have %d x %d",
        driving->root, resized, total, first_resized->sensor, lens->cx, lens->cy, 2 * lens->cx, 2 * lens->cy,
        lens->width, lens->height);
  }
  if (aside > 0)
    PAGS_WARN(
        "%s/intrinsics: %d of %d cameras have a principal point far from the middle, the first is camera %d: %g %g in "
        "photographs of %d x %d; intrinsics may be wrong",
        driving->root, aside, total, first_aside->sensor, first_aside->lens.cx, first_aside->lens.cy,
        first_aside->lens.width, first_aside->lens.height);
  if (stretched > 0)
    PAGS_WARN(
        "%s/intrinsics: %d of %d cameras have focal lengths that differ by more than a quarter, the first is camera "
        "%d: %g and %g; intrinsics may be wrong",
        driving->root, stretched, total, first_stretched->sensor, first_stretched->lens.fx, first_stretched->lens.fy);
  return PAGS_OK;
}

/* ---- Cameras that stand upright and drive ---- */

/* Metres that a camera must have come for its way to be judged, and the sine of the steepest way. */
static const double least_way = 2, steepest = 0.7;

/* Another reading of the extrinsics. */
enum { AS_READ, INVERTED, OTHER_AXES, BOTH, READINGS };

/* Rotation whose columns are OpenCV's axes in Waymo's (x forward, y left, z up). */
static const double waymo_from_opencv[12] = {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0};

/* Returns the cosine of the angle between the picture's upward direction and up, for another reading of a pose that was
 * read with the axes of the rules. */
static double uprightness(const pags_driving *driving, const double read[12], int reading) {
  double back[12], pose[12];
  memcpy(pose, read, sizeof pose);
  pags_rigid_inverse(waymo_from_opencv, back);
  if (driving->rules.waymo_axes)
    pags_rigid_multiply(pose, back, pose); /* as it is in the file */
  if (reading == INVERTED || reading == BOTH)
    pags_rigid_inverse(pose, pose);
  const bool other = reading == OTHER_AXES || reading == BOTH;
  if (driving->rules.waymo_axes != other)
    pags_rigid_multiply(pose, waymo_from_opencv, pose);
  return -pose[9]; /* the second column is the picture's downward direction */
}

/* Looks at the extrinsics that each camera's first photograph has: to the car or, per frame, to the world. */
static void check_upright(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  static const char *const advice[] = {
      "", "; inverted they would be upright: expected camera-to-car (or camera-to-world), not its inverse",
      "; with the other camera_axes of dataset.json (--kind) they would be upright",
      "; inverted and with the other camera_axes of dataset.json (--kind) they would be upright"};
  int total = 0, upright[READINGS] = {0}, first = -1;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const pags_sensor *sensor = &driving->sensors[i];
    const pags_parsed_view *view = find_view(parsed, sensor, NULL);
    if (!view)
      continue;
    const double *pose = driving->rules.per_frame ? view->world_from_camera : sensor->ego_from_camera;
    total++;
    for (int r = 0; r < READINGS; r++)
      upright[r] += uprightness(driving, pose, r) > 0.5;
    if (uprightness(driving, pose, AS_READ) <= 0.5)
      first = first < 0 ? sensor->number : first;
  }
  int better = AS_READ;
  for (int r = BOTH; r > AS_READ; r--)
    better = upright[r] == total ? r : better;
  if (first >= 0)
    PAGS_WARN(
        "%s/extrinsics: %d of %d cameras don't stand upright, the first is camera %d: extrinsics or camera_axes may be "
        "wrong%s",
        driving->root, total - upright[AS_READ], total, first, advice[better]);
}

/* Warns of cameras that move up or down rather than forward, as they do with inverted poses of each exposure: these
 * have the way of the car along the camera's axis as height. */
static void check_way(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  int total = 0, climbing = 0, first = 0;
  double height = 0, way = 0;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const pags_parsed_view *begin = find_view(parsed, &driving->sensors[i], NULL), *end = begin;
    for (int64_t j = 0; j < parsed->count; j++)
      if (is_seen_by(&parsed->views[j], &driving->sensors[i]))
        end = &parsed->views[j];
    if (!begin)
      continue;
    double from[3], d[3];
    pags_pose_position(begin->world_from_camera, from);
    pags_pose_position(end->world_from_camera, d);
    pags_subtract3(d, from, d);
    const double square = pags_dot3(d, d);
    total++;
    if (square < least_way * least_way || fabs(d[2]) < steepest * sqrt(square) || climbing++ > 0)
      continue;
    first = driving->sensors[i].number;
    height = d[2];
    way = sqrt(square);
  }
  if (climbing > 0)
    PAGS_WARN(
        "%s/%s: %d of %d cameras move up or down, the first is camera %d: by %.1f m on %.1f m; poses may be inverted, "
        "expected camera-to-world (or car-to-world), z up",
        driving->root, driving->rules.per_frame ? "extrinsics" : "ego_pose", climbing, total, first, height, way);
}

pags_result pags_calibration_check(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  PAGS_TRY(check_sizes(driving, parsed));
  PAGS_TRY(check_lenses(driving, parsed));
  check_upright(driving, parsed);
  check_way(driving, parsed);
  return PAGS_OK;
}
