/* SPDX-License-Identifier: Apache-2.0 */
/* Tells from the cameras, the car and the boxes which way is up in a driving set, and compares it with the world's z.
 *
 * Roads rise by 20 degrees at most, and cameras look down by little more; but the means over a recording of the car's
 * and of its cameras' upward directions are both as far off only if the world's axes are others: y up, as in Unity and
 * in OpenGL, z down, as in aviation (NED), or earth-fixed (ECEF), where up points away from the centre of the earth. */
#include "dataset/driving/check/checks.h"

#include "base/log.h"
#include "base/vec3.h"
#include "maths/maths.h"

#include <math.h>
#include <string.h>

static const double degrees = 57.29577951308232;
static const double steepest = 20, steepest_ecef = 3; /* degrees off the world's z: where that is, and isn't, all */
/* Metres from the centre of the earth of places on it (WGS84, with 9 km up and 1 km down), and how far up may be off
 * the direction from there: the roughness of roads and of directions of cameras. */
static const double least_earth = 6.355e6, most_earth = 6.388e6, off_earth = 15;

/* A sum of unit vectors. */
typedef struct direction {
  double sum[3];
  int64_t count;
} direction;

static void add(direction *d, const double pose[12], int column, double sign) {
  for (int k = 0; k < 3; k++)
    d->sum[k] += sign * pose[4 * k + column];
  d->count++;
}

/* The angle in degrees between the mean of a direction and an axis; 0 without one. */
static double angle(const direction *d, const double axis[3]) {
  const double squares = pags_dot3(d->sum, d->sum) * pags_dot3(axis, axis);
  return squares > 0 ? degrees * pags_acos(fmax(-1, fmin(1, pags_dot3(d->sum, axis) / sqrt(squares)))) : 0;
}

void pags_world_check(const pags_driving *driving, const pags_parsed_dataset *parsed) {
  static const double up[3] = {0, 0, 1};
  direction cameras = {{0}, 0}, car = {{0}, 0}, boxes = {{0}, 0};
  double place[3] = {0};
  for (int64_t i = 0; i < parsed->count; i++) {
    const pags_parsed_view *view = &parsed->views[i];
    if (view->missing)
      continue;
    double position[3], back[12], ego[12];
    add(&cameras, view->world_from_camera, 1, -1); /* the second column is the picture's downward direction */
    pags_pose_position(view->world_from_camera, position);
    pags_add3(place, position, place);
    if (driving->rules.per_frame)
      continue;
    pags_rigid_inverse(driving->sensors[i % driving->sensor_count].ego_from_camera, back);
    pags_rigid_multiply(view->world_from_camera, back, ego);
    add(&car, ego, 2, 1);
  }
  const double off = car.count ? fmin(angle(&cameras, up), angle(&car, up)) : angle(&cameras, up);
  pags_divide3(place, (double)(cameras.count ? cameras.count : 1));
  const double radius = pags_length3(place);
  const bool on_earth = radius > least_earth && radius < most_earth && angle(&cameras, place) < off_earth;
  const char *folder = driving->rules.per_frame ? "extrinsics" : "ego_pose";
  if (on_earth && off > steepest_ecef)
    PAGS_WARN(
        "%s/%s: positions are %.0f km from zero, and up is the direction from there, %.0f degrees off the world's z: "
        "axes look earth-fixed (ECEF); expected z up: turn poses and boxes to east, north, up",
        driving->root, folder, radius / 1000, off);
  else if (off > steepest)
    PAGS_WARN(
        "%s/%s: cameras don't stand upright in the world: their upward direction is %.0f degrees off its z in the mean "
        "of %lld photographs; expected z up: turn poses and boxes, or correct ego_pose",
        driving->root, folder, off, (long long)cameras.count);

  for (int64_t i = 0; i < driving->object_count; i++)
    for (int64_t k = 0; k < driving->objects[i].keyframe_count; k++)
      add(&boxes, driving->objects[i].keyframes[k].world_from_object, 2, 1);
  const double apart = angle(&boxes, cameras.sum);
  if (apart > steepest && angle(&boxes, up) > steepest)
    PAGS_WARN(
        "%s/instances/instances_info.json: %lld boxes stand %.0f degrees off the cameras' upward direction in the "
        "mean; expected boxes whose z points up",
        driving->root, (long long)boxes.count, apart);
}
