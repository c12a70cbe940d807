/* SPDX-License-Identifier: Apache-2.0 */
/* 3-vectors, and the vectors in 3x4 row-major poses [R|t], in double and (suffix f) in float. Sums run from left to
 * right, (x + y) + z, and nothing is fused: callers whose results must not change by a bit rely on that order. `out`
 * may be an argument unless its function says otherwise. */
#ifndef PAGS_BASE_VEC3_H
#define PAGS_BASE_VEC3_H

#include <math.h>
#include <string.h>

static inline double pags_dot3(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline float pags_dot3f(const float a[3], const float b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double pags_length3(const double v[3]) {
  return sqrt(pags_dot3(v, v));
}
static inline float pags_length3f(const float v[3]) {
  return sqrtf(pags_dot3f(v, v));
}

static inline void pags_copy3(const double v[3], double out[3]) {
  memmove(out, v, 3 * sizeof *out);
}
static inline void pags_copy3f(const float v[3], float out[3]) {
  memmove(out, v, 3 * sizeof *out);
}
static inline void pags_widen3(const float v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = (double)v[k];
}
static inline void pags_narrow3(const double v[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = (float)v[k];
}

static inline void pags_add3(const double a[3], const double b[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[k] + b[k];
}
static inline void pags_add3f(const float a[3], const float b[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[k] + b[k];
}
/* out = a - b */
static inline void pags_subtract3(const double a[3], const double b[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[k] - b[k];
}
static inline void pags_subtract3f(const float a[3], const float b[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[k] - b[k];
}
/* out = s v */
static inline void pags_scale3(double s, const double v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = s * v[k];
}
static inline void pags_scale3f(float s, const float v[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = s * v[k];
}
/* out += s v. With s = 1 or -1 the bits are those of a sum or a difference. */
static inline void pags_add_scaled3(double s, const double v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] += s * v[k];
}
static inline void pags_add_scaled3f(float s, const float v[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] += s * v[k];
}
/* out = v + s w, the point at distance s along the ray from v with direction w. */
static inline void pags_along3(const double v[3], double s, const double w[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = v[k] + s * w[k];
}
static inline void pags_along3f(const float v[3], float s, const float w[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = v[k] + s * w[k];
}

/* v /= s: a division per component, not a product with 1/s. */
static inline void pags_divide3(double v[3], double s) {
  for (int k = 0; k < 3; k++)
    v[k] /= s;
}
static inline void pags_divide3f(float v[3], float s) {
  for (int k = 0; k < 3; k++)
    v[k] /= s;
}

/* Scales v to unit length, unless it is 0, and returns the length it had. */
static inline float pags_normalise3f(float v[3]) {
  const float length = pags_length3f(v);
  if (length > 0.0f)
    pags_divide3f(v, length);
  return length;
}

/* Widens the box [lo, hi] to hold the point p. */
static inline void pags_box_add3(const double p[3], double lo[3], double hi[3]) {
  for (int k = 0; k < 3; k++) {
    lo[k] = fmin(lo[k], p[k]);
    hi[k] = fmax(hi[k], p[k]);
  }
}

static inline double pags_distance_squared3(const double a[3], const double b[3]) {
  const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
  return pags_dot3(d, d);
}
static inline double pags_distance3(const double a[3], const double b[3]) {
  return sqrt(pags_distance_squared3(a, b));
}

/* `out` is neither `a` nor `b`. */
static inline void pags_cross3(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}
static inline void pags_cross3f(const float a[3], const float b[3], float out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out = R v; `out` is not `v`. For R v + t in double see pags_rigid_point. */
static inline void pags_rotate3(const double pose[12], const double v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pags_dot3(pose + 4 * k, v);
}
static inline void pags_rotate3f(const float pose[12], const float v[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pags_dot3f(pose + 4 * k, v);
}
/* out = R p + t; `out` is not `p`. */
static inline void pags_transform3f(const float pose[12], const float p[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pags_dot3f(pose + 4 * k, p) + pose[4 * k + 3];
}

/* out = t */
static inline void pags_pose_position(const double pose[12], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pose[4 * k + 3];
}

/* Distance between the positions of two poses. */
static inline double pags_pose_distance(const double a[12], const double b[12]) {
  const double d[3] = {a[3] - b[3], a[7] - b[7], a[11] - b[11]};
  return pags_length3(d);
}

/* t = position */
static inline void pags_pose_place(double pose[12], const double position[3]) {
  for (int k = 0; k < 3; k++)
    pose[4 * k + 3] = position[k];
}

/* pose = [R|t] of a row-major 3x3 matrix; and R of a pose. */
static inline void pags_pose_make(const double r[9], const double t[3], double pose[12]) {
  for (int k = 0; k < 3; k++) {
    memcpy(pose + 4 * k, r + 3 * k, 3 * sizeof *r);
    pose[4 * k + 3] = t[k];
  }
}
static inline void pags_pose_rotation(const double pose[12], double r[9]) {
  for (int k = 0; k < 3; k++)
    memcpy(r + 3 * k, pose + 4 * k, 3 * sizeof *r);
}

/* t -= by: from absolute coordinates to those relative to a scene's origin `by`. */
static inline void pags_pose_subtract(double pose[12], const double by[3]) {
  for (int k = 0; k < 3; k++)
    pose[4 * k + 3] -= by[k];
}

/* The quaternion w x y z of the rotation b followed by the rotation a; `out` may be either. */
static inline void pags_quaternion_multiply(const double a[4], const double b[4], double out[4]) {
  const double product[4] = {
      a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
      a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1], a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
  for (int k = 0; k < 4; k++)
    out[k] = product[k];
}

#endif
