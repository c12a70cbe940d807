/* SPDX-License-Identifier: Apache-2.0 */
/* Where an object is at a time.
 *
 * A track that has been trained is the curve through its trained knots' poses, label * Exp(increment), for these are
 * better known than any label: what a held-out label says is off by its own jitter, and what it would be corrected by,
 * the neighbours' increments, by theirs. Between two trained knots the curve is the cubic of Hermite whose velocity at
 * a knot is that of the parabola through it and its neighbours, in the six numbers of the pose relative to the first of
 * the two (translation and rotation vector): continuous velocities, and exact wherever acceleration is constant. A
 * track without increments, or across a longer gap, is its labels, interpolated on their own (translation linear,
 * rotation along the shorter arc of quaternions), times the increments, interpolated linearly. */
#include <pags/object.h>

#include <pags/camera.h>

#include <math.h>
#include <string.h>

/* Two times are the same: a tenth of the shortest shutter, and four steps of a double at Unix time. */
static const double same_time = 1e-6;
/* Median spacings of the knots: no curve is drawn across a longer gap between trained ones. One held-out knot is
 * bridged. */
static const double longest_bridge = 2.5;

enum { CHANNELS = 6 }; /* of a pose beside another: rotation vector, translation */

/* Exp([r]x) = I + sin a / a [r]x + (1 - cos a) / a^2 [r]x^2, a = |r| (Rodrigues); near 0 by its series. */
void pags_increment_matrix(const double rotation[3], const double translation[3], double out[12]) {
  double x = rotation[0], y = rotation[1], z = rotation[2];
  double square = x * x + y * y + z * z, angle = sqrt(square), half = sin(0.5 * angle);
  double s = angle < 1e-4 ? 1 - square / 6 : sin(angle) / angle;
  double c = angle < 1e-4 ? 0.5 - square / 24 : 2 * half * half / square;
  const double turn[9] = {1 - c * (y * y + z * z), c * x * y - s * z,       c * x * z + s * y,
                          c * x * y + s * z,       1 - c * (x * x + z * z), c * y * z - s * x,
                          c * x * z - s * y,       c * y * z + s * x,       1 - c * (x * x + y * y)};
  for (int i = 0; i < 3; i++) {
    memcpy(out + 4 * i, turn + 3 * i, 3 * sizeof *turn);
    out[4 * i + 3] = translation[i];
  }
}

static void quaternion_of(const double m[12], double q[4]) {
  const double r[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]};
  pags_quaternion_from_rotation(r, q);
}

/* Along the shorter arc; where that is below 1e-3 rad a straight line differs by less than 1e-10. */
static void interpolate_rotation(const double a[4], const double b[4], double share, double out[4]) {
  double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
  double sign = dot < 0 ? -1 : 1, angle = acos(fmin(fabs(dot), 1)), sine = sin(angle);
  double from = angle < 1e-3 ? 1 - share : sin((1 - share) * angle) / sine;
  double to = angle < 1e-3 ? share : sin(share * angle) / sine;
  for (int i = 0; i < 4; i++)
    out[i] = from * a[i] + sign * to * b[i];
}

void pags_increment_rotation(const double m[12], double rotation[3]) {
  double q[4];
  quaternion_of(m, q);
  double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  double scale = sine > 1e-12 ? 2 * atan2(sine, q[0]) / sine : 2;
  for (int i = 0; i < 3; i++)
    rotation[i] = scale * q[1 + i];
}

static void interpolate_pose(const double a[12], const double b[12], double share, double out[12]) {
  double from[4], to[4], q[4], r[9];
  quaternion_of(a, from);
  quaternion_of(b, to);
  interpolate_rotation(from, to, share, q);
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++) {
    memcpy(out + 4 * i, r + 3 * i, 3 * sizeof *r);
    out[4 * i + 3] = (1 - share) * a[4 * i + 3] + share * b[4 * i + 3];
  }
}

/* Whether the median spacing of the knots (of an even number the upper middle one) is at least `length`: counting says
 * it without sorting. One knot alone has no spacing. */
static int median_reaches(const pags_object *object, double length) {
  int64_t spacings = object->knot_count - 1, shorter = 0;
  for (int64_t i = 0; i < spacings; i++)
    shorter += object->knots[i + 1].time - object->knots[i].time < length - same_time;
  return spacings > 0 && shorter <= spacings / 2;
}

/* The label at `time`, `after` knots lying at or before it. */
static int label_at(const pags_object *object, double time, int64_t after, double out[12]) {
  const pags_knot *before = after > 0 ? &object->knots[after - 1] : NULL;
  const pags_knot *behind = after < object->knot_count ? &object->knots[after] : NULL;
  double since = before ? time - before->time : INFINITY, until = behind ? behind->time - time : INFINITY;
  const pags_knot *nearest = since <= until ? before : behind;
  double distance = fmin(since, until);
  if (!(distance < INFINITY)) /* a time that is no number */
    return 0;
  if (distance > same_time && before && behind && median_reaches(object, (since + until) / 1.5))
    interpolate_pose(before->world_from_object, behind->world_from_object, since / (since + until), out);
  else if (distance <= same_time || median_reaches(object, 2 * distance))
    memcpy(out, nearest->world_from_object, 12 * sizeof *out);
  else
    return 0;
  return 1;
}

/* The last trained knot of those before index `end`, the first one from `begin` on; NULL: none. */
static const pags_knot *last_trained(const pags_object *object, int64_t end) {
  for (int64_t i = end - 1; i >= 0; i--)
    if (object->knots[i].trained)
      return &object->knots[i];
  return NULL;
}

static const pags_knot *first_trained(const pags_object *object, int64_t begin) {
  for (int64_t i = begin; i < object->knot_count; i++)
    if (object->knots[i].trained)
      return &object->knots[i];
  return NULL;
}

static int has_increment(const pags_knot *k) {
  return k->rotation[0] != 0 || k->rotation[1] != 0 || k->rotation[2] != 0 || k->translation[0] != 0 ||
         k->translation[1] != 0 || k->translation[2] != 0;
}

static void trained_pose(const pags_knot *k, double out[12]) {
  double motion[12];
  pags_increment_matrix(k->rotation, k->translation, motion);
  pags_rigid_multiply(k->world_from_object, motion, out);
}

/* Whether a curve is drawn from one trained knot to the next. */
static int bridges(const pags_object *object, const pags_knot *a, const pags_knot *b) {
  return a && b && b->time - a->time > same_time && median_reaches(object, (b->time - a->time) / longest_bridge);
}

/* A trained knot's pose relative to `from`: rotation vector, then translation along the world's axes. */
static void displacement(const double from[12], const pags_knot *k, double out[CHANNELS]) {
  double to[12], back[12], between[12];
  trained_pose(k, to);
  pags_rigid_inverse(from, back);
  pags_rigid_multiply(back, to, between);
  pags_increment_rotation(between, out);
  for (int i = 0; i < 3; i++)
    out[3 + i] = to[4 * i + 3] - from[4 * i + 3];
}

/* The velocity at the middle one of three knots of the parabola through them; v0 and v1 are the mean velocities before
 * and behind it, over h0 and h1 seconds. */
static double middle_velocity(double v0, double h0, double v1, double h1) {
  return (v0 * h1 + v1 * h0) / (h0 + h1);
}

/* The curve between trained knots a and b. Where a knot has none before or behind it to take its velocity from, the
 * parabola through the other three goes on, or a straight line through the two. */
static void curve_at(const pags_object *object, const pags_knot *a, const pags_knot *b, double time, double out[12]) {
  const pags_knot *before = last_trained(object, a - object->knots),
                  *behind = first_trained(object, b - object->knots + 1);
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

/* Multiplies the labelled pose by the increment between those of a and b, at least one of which is a knot. */
static void correct(const pags_knot *a, const pags_knot *b, double time, double out[12]) {
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
  /* The number of knots at or before `time`. */
  int64_t low = 0, high = object->knot_count;
  while (low < high) {
    int64_t middle = low + (high - low) / 2;
    if (object->knots[middle].time <= time)
      low = middle + 1;
    else
      high = middle;
  }
  const int64_t after = low;

  if (!label_at(object, time, after, out))
    return 0;
  /* A knot at this very time is on both sides. */
  const int next_is_now = after < object->knot_count && object->knots[after].time - time <= same_time;
  const int last_is_now = after > 0 && time - object->knots[after - 1].time <= same_time;
  const pags_knot *a = last_trained(object, after + next_is_now), *b = first_trained(object, after - last_is_now);
  if (bridges(object, a, b) && (has_increment(a) || has_increment(b)))
    curve_at(object, a, b, time, out);
  else if (a || b)
    correct(a, b, time, out);
  return 1;
}
