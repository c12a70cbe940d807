/* SPDX-License-Identifier: Apache-2.0 */
/* 3-vectors, and the vectors in 3x4 row-major poses [R|t], in double and (suffix f) in float. Sums run from left to
 * right, (x + y) + z, and nothing is fused: callers whose results must not change by a bit rely on that order. `out`
 * may be an argument unless its function says otherwise. */
#ifndef PAGS_BASE_VEC3_H
#define PAGS_BASE_VEC3_H

#include <math.h>

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

/* out += s v. With s = -1 the bits are those of a subtraction. */
static inline void pags_add_scaled3(double s, const double v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] += s * v[k];
}

/* v /= s: a division per component, not a product with 1/s. */
static inline void pags_divide3(double v[3], double s) {
  for (int k = 0; k < 3; k++)
    v[k] /= s;
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

/* out = R v; `out` is not `v`. For R v + t see pags_rigid_point. */
static inline void pags_rotate3(const double pose[12], const double v[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pags_dot3(pose + 4 * k, v);
}

/* out = t */
static inline void pags_pose_position(const double pose[12], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pose[4 * k + 3];
}

/* t -= by: from absolute coordinates to those relative to a scene's origin `by`. */
static inline void pags_pose_subtract(double pose[12], const double by[3]) {
  for (int k = 0; k < 3; k++)
    pose[4 * k + 3] -= by[k];
}

#endif
