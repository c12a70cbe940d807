/* SPDX-License-Identifier: Apache-2.0 */
/* Dot product, length and cross product of 3-vectors, in double and (suffix f) in float. Sums are taken from left to
 * right, (x + y) + z; callers whose results must not change by a bit rely on that order. */
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

#endif
