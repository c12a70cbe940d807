/* SPDX-License-Identifier: Apache-2.0 */
/* Computes the pose of an object at a time from its track.
 *
 * A trained track is a curve through the poses of its trained keyframes, label * Exp(increment). Labels of held-out
 * keyframes are not used: such a label carries its own jitter, and the increments of its neighbours, by which it would
 * have to be corrected, make up for the jitter of the neighbours' labels. Between two trained keyframes the curve is a
 * cubic Hermite spline in six numbers, the rotation vector and the translation relative to the first of the two. Its
 * velocity at a keyframe is that of the parabola through the keyframe and its two neighbours, so that velocities are
 * continuous and motion of constant acceleration is met exactly.
 *
 * Where no increment is, or the gap between trained keyframes is too long, the labels are interpolated (translation
 * linearly, rotation along the shorter arc of the quaternions) and multiplied by the linearly interpolated
 * increments.
 */
#include <pags/object.h>

#include <pags/camera.h>

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/vec3.h"
#include "maths/maths.h"

/* Times that differ by at most this many seconds count as the same: a tenth of the shortest shutter time, and four
 * steps of a double at Unix time. */
static const double same_time = 1e-6;
/* The longest gap between two trained keyframes that the curve spans, in multiples of the median spacing of the
 * keyframes: long enough for one held-out keyframe between them. */
static const double longest_bridge = 2.5;

enum { CHANNELS = 6 }; /* of a relative pose: rotation vector (3), translation (3) */

/* ---- Rotations and poses ---- */

/* Rodrigues' formula for the rotation, with the Taylor series of its two coefficients for a < 1e-4:
 *     Exp([r]x) = I + sin a / a [r]x + (1 - cos a) / a^2 [r]x^2,   a = |r| */
void pags_increment_matrix(const double rotation[3], const double translation[3], double out[12]) {
  double x = rotation[0], y = rotation[1], z = rotation[2];
  double square = x * x + y * y + z * z, angle = sqrt(square), half = pags_sin(0.5 * angle);
  double s = angle < 1e-4 ? 1 - square / 6 : pags_sin(angle) / angle;
  double c = angle < 1e-4 ? 0.5 - square / 24 : 2 * half * half / square;
  const double turn[9] = {1 - c * (y * y + z * z), c * x * y - s * z,       c * x * z + s * y,
                          c * x * y + s * z,       1 - c * (x * x + z * z), c * y * z - s * x,
                          c * x * z - s * y,       c * y * z + s * x,       1 - c * (x * x + y * y)};
  pags_pose_make(turn, translation, out);
}

/* Computes the unit quaternion q of the rotation of m. */
static void quaternion_of(const double m[12], double q[4]) {
  double r[9];
  pags_pose_rotation(m, r);
  pags_quaternion_from_rotation(r, q);
}

void pags_increment_rotation(const double m[12], double rotation[3]) {
  double q[4];
  quaternion_of(m, q);
  double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  double scale = sine > 1e-12 ? 2 * pags_atan2(sine, q[0]) / sine : 2;
  for (int i = 0; i < 3; i++)
    rotation[i] = scale * q[1 + i];
}

/* The pose `share` (0..1) of the way from a to b: translation linearly, rotation by spherical linear interpolation
 * (Shoemake 1985) of unit quaternions along the shorter arc. Below 1e-3 rad it is linear, which differs by less than
 * 1e-10. */
static void interpolate_pose(const double a[12], const double b[12], double share, double out[12]) {
  double p[4], q[4], r[9], place[3];
  quaternion_of(a, p);
  quaternion_of(b, q);
  const double dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3];
  const double sign = dot < 0 ? -1 : 1, angle = pags_acos(fmin(fabs(dot), 1)), sine = pags_sin(angle);
  const double from = angle < 1e-3 ? 1 - share : pags_sin((1 - share) * angle) / sine;
  const double to = angle < 1e-3 ? share : pags_sin(share * angle) / sine;
  for (int i = 0; i < 4; i++)
    q[i] = from * p[i] + sign * to * q[i];
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++)
    place[i] = (1 - share) * a[4 * i + 3] + share * b[4 * i + 3];
  pags_pose_make(r, place, out);
}

/* ---- Labels ---- */

/* Returns whether the median time between neighbouring keyframes (for an even number, the upper of the middle two) is
 * at least `length` seconds. It suffices to count the shorter ones, without sorting. A single keyframe has the spacing
 * of the time steps. */
static bool median_reaches(const pags_object *object, double length) {
  int64_t spacings = object->keyframe_count - 1, shorter = 0;
  if (spacings == 0)
    return object->time_step >= length - same_time;
  for (int64_t i = 0; i < spacings; i++)
    shorter += object->keyframes[i + 1].time - object->keyframes[i].time < length - same_time;
  return shorter <= spacings / 2;
}

/* Computes the labelled pose at `time` into `out`, `after` being the number of keyframes at or before `time`. Returns 0
 * if the object isn't there: more than half a median spacing beyond an end of its track or into a gap of more than
 * 1.5. */
static bool label_at(const pags_object *object, double time, int64_t after, double out[12]) {
  const pags_keyframe *before = after > 0 ? &object->keyframes[after - 1] : NULL;
  const pags_keyframe *behind = after < object->keyframe_count ? &object->keyframes[after] : NULL;
  double since = before ? time - before->time : INFINITY, until = behind ? behind->time - time : INFINITY;
  const pags_keyframe *nearest = since <= until ? before : behind;
  double distance = fmin(since, until);
  if (!(distance < INFINITY)) /* `time` is NaN or infinite */
    return false;
  if (distance > same_time && before && behind && median_reaches(object, (since + until) / 1.5))
    interpolate_pose(before->world_from_object, behind->world_from_object, since / (since + until), out);
  else if (distance <= same_time || median_reaches(object, 2 * distance))
    memcpy(out, nearest->world_from_object, 12 * sizeof *out);
  else
    return false;
  return true;
}

/* ---- The curve through trained keyframes ---- */

/* Returns the last trained keyframe before index `end`, or NULL. */
static const pags_keyframe *last_trained(const pags_object *object, int64_t end) {
  for (int64_t i = end - 1; i >= 0; i--)
    if (object->keyframes[i].trained)
      return &object->keyframes[i];
  return NULL;
}

/* Returns the first trained keyframe from index `begin` on, or NULL. */
static const pags_keyframe *first_trained(const pags_object *object, int64_t begin) {
  for (int64_t i = begin; i < object->keyframe_count; i++)
    if (object->keyframes[i].trained)
      return &object->keyframes[i];
  return NULL;
}

static bool has_increment(const pags_keyframe *k) {
  return k->rotation[0] != 0 || k->rotation[1] != 0 || k->rotation[2] != 0 || k->translation[0] != 0 ||
         k->translation[1] != 0 || k->translation[2] != 0;
}

/* The pose of a trained keyframe: label * Exp(increment). */
static void trained_pose(const pags_keyframe *k, double out[12]) {
  double motion[12];
  pags_increment_matrix(k->rotation, k->translation, motion);
  pags_rigid_multiply(k->world_from_object, motion, out);
}

/* Returns whether the curve spans the gap from trained keyframe a to b, the next (either may be NULL: no). */
static bool bridges(const pags_object *object, const pags_keyframe *a, const pags_keyframe *b) {
  return a && b && b->time - a->time > same_time && median_reaches(object, (b->time - a->time) / longest_bridge);
}

/* Computes the pose of trained keyframe k relative to the pose `from`: the rotation vector in the frame of `from`, then
 * the translation along the world's axes. */
static void displacement(const double from[12], const pags_keyframe *k, double out[CHANNELS]) {
  double to[12], back[12], between[12];
  trained_pose(k, to);
  pags_rigid_inverse(from, back);
  pags_rigid_multiply(back, to, between);
  pags_increment_rotation(between, out);
  for (int i = 0; i < 3; i++)
    out[3 + i] = to[4 * i + 3] - from[4 * i + 3];
}

/* The velocity, at the middle one of three keyframes, of the parabola through the three: v0 is the mean velocity over
 * the h0 seconds before it, v1 that over the h1 seconds after it. */
static double middle_velocity(double v0, double h0, double v1, double h1) {
  return (v0 * h1 + v1 * h0) / (h0 + h1);
}

/* Computes the pose at `time` on the curve between trained keyframes a and b. If no trained keyframe is near enough
 * before a (or after b), the velocity there is that of the parabola through the other three keyframes; if neither side
 * has one, the curve is a straight line from a to b. */
static void curve_at(const pags_object *object, const pags_keyframe *a, const pags_keyframe *b, double time,
                     double out[12]) {
  const pags_keyframe *before = last_trained(object, a - object->keyframes),
                      *behind = first_trained(object, b - object->keyframes + 1);
  const int has_before = bridges(object, before, a), has_behind = bridges(object, b, behind);
  const double gap = b->time - a->time, u = (time - a->time) / gap, zero[3] = {0, 0, 0};
  double pose[12], turn[12], to_b[CHANNELS], to_before[CHANNELS], to_behind[CHANNELS], x[CHANNELS];
  trained_pose(a, pose);
  displacement(pose, b, to_b);
  if (has_before)
    displacement(pose, before, to_before);
  if (has_behind)
    displacement(pose, behind, to_behind);
  for (int i = 0; i < CHANNELS; i++) {
    const double mean = to_b[i] / gap, h0 = has_before ? a->time - before->time : 0,
                 h1 = has_behind ? behind->time - b->time : 0;
    double v = has_before ? middle_velocity(-to_before[i] / h0, h0, mean, gap) : mean;
    double w = has_behind ? middle_velocity(mean, gap, (to_behind[i] - to_b[i]) / h1, h1) : 2 * mean - v;
    if (!has_before)
      v = 2 * mean - w;
    x[i] = gap * u * ((1 - u) * (1 - u) * v + (3 - 2 * u) * u * mean - u * (1 - u) * w);
  }
  pags_increment_matrix(x, zero, turn);
  pags_rigid_multiply(pose, turn, out);
  for (int i = 0; i < 3; i++)
    out[4 * i + 3] = pose[4 * i + 3] + x[3 + i];
}

/* ---- Increments and the pose at a time ---- */

/* Multiplies the labelled pose `out` by the increment at `time`, interpolated linearly between those of trained
 * keyframes a and b. One of them may be NULL: then the other's increment is taken. */
static void correct(const pags_keyframe *a, const pags_keyframe *b, double time, double out[12]) {
  double rotation[3], translation[3], motion[12];
  a = a ? a : b;
  b = b ? b : a;
  if (!has_increment(a) && !has_increment(b))
    return;
  double gap = b->time - a->time, share = gap > 0 ? fmin(fmax((time - a->time) / gap, 0), 1) : 0;
  for (int i = 0; i < 3; i++) {
    rotation[i] = (1 - share) * a->rotation[i] + share * b->rotation[i];
    translation[i] = (1 - share) * a->translation[i] + share * b->translation[i];
  }
  pags_increment_matrix(rotation, translation, motion);
  pags_rigid_multiply(out, motion, out);
}

int pags_object_pose(const pags_object *object, double time, double out[12]) {
  /* Bisection: `after` is the number of keyframes at or before `time`. */
  int64_t low = 0, high = object->keyframe_count;
  while (low < high) {
    int64_t middle = low + (high - low) / 2;
    if (object->keyframes[middle].time <= time)
      low = middle + 1;
    else
      high = middle;
  }
  const int64_t after = low;

  if (!label_at(object, time, after, out))
    return 0;
  /* A keyframe at this very time counts both as the last one before it and as the first one after it. */
  const int next_is_now = after < object->keyframe_count && object->keyframes[after].time - time <= same_time;
  const int last_is_now = after > 0 && time - object->keyframes[after - 1].time <= same_time;
  const pags_keyframe *a = last_trained(object, after + next_is_now), *b = first_trained(object, after - last_is_now);
  if (bridges(object, a, b) && (has_increment(a) || has_increment(b)))
    curve_at(object, a, b, time, out);
  else if (a || b)
    correct(a, b, time, out);
  return 1;
}
