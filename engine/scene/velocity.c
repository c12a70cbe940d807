/* SPDX-License-Identifier: Apache-2.0 */
/* Velocities of poses and of objects along their tracks; points as seen by a camera with a rolling shutter. */
#include <pags/camera.h>
#include <pags/object.h>

#include <math.h>
#include <string.h>

#include "base/vec3.h"

void pags_rigid_move(const double m[12], const double velocity[6], double seconds, double out[12]) {
  double turn[3], shift[3], motion[12];
  pags_scale3(seconds, velocity, turn);
  pags_scale3(seconds, velocity + 3, shift);
  pags_increment_matrix(turn, shift, motion);
  pags_rigid_multiply(m, motion, out);
}

void pags_rigid_velocity(const double a[12], const double m[12], const double b[12], double seconds,
                         double velocity[6]) {
  double back[12], motion[12], turn[3], world[6];
  pags_rigid_inverse(a, back);
  pags_rigid_multiply(back, b, motion);
  pags_increment_rotation(motion, turn);
  pags_rotate3(a, turn, world);
  for (int k = 0; k < 3; k++)
    world[3 + k] = b[4 * k + 3] - a[4 * k + 3];
  for (int k = 0; k < 6; k++) {
    const double *const v = world + k / 3 * 3;
    velocity[k] = (m[k % 3] * v[0] + m[4 + k % 3] * v[1] + m[8 + k % 3] * v[2]) / seconds;
  }
}

/* By iteration: the error shrinks in each step by the lines that the point moves while one is read. */
void pags_camera_see(const pags_camera *camera, const double middle[3], double out[3]) {
  const double stand[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, from[3] = {middle[0], middle[1], middle[2]};
  const double most = fabs(camera->shutter.across + camera->shutter.down);
  double at[2], moved[12];
  memcpy(out, from, sizeof from);
  for (int step = 0; pags_camera_rolls(camera) && step < 5 && pags_camera_project(camera, out, at, NULL); step++) {
    const double read = pags_camera_read_at(camera, at[0], at[1]);
    pags_rigid_move(stand, camera->shutter.velocity, fmin(fmax(read, -most), most), moved);
    pags_rigid_inverse(moved, moved);
    pags_rigid_point(moved, from, out);
  }
}

void pags_object_velocity(const pags_object *object, double time, double velocity[6]) {
  const double half = 0.05; /* seconds: where labels come every tenth, the parabola through three of them */
  /* A track is constant beyond its ends, which isn't the motion of the object. */
  const double begin = fmax(time - half, object->keyframes[0].time),
               end = fmin(time + half, object->keyframes[object->keyframe_count - 1].time);
  double before[12], now[12], after[12];
  memset(velocity, 0, 6 * sizeof *velocity);
  if (end - begin > 1e-6 && pags_object_pose(object, begin, before) && pags_object_pose(object, time, now) &&
      pags_object_pose(object, end, after))
    pags_rigid_velocity(before, now, after, end - begin, velocity);
}
