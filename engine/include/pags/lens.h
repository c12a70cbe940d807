/* SPDX-License-Identifier: Apache-2.0 */
/* Lenses: projection of directions to the picture, and its inverse. A lens maps a direction (X,
 * Y, Z) of the camera's frame (OpenCV's axes) to a point of the plane z = 1, in focal lengths from the principal point;
 * the camera (pags/camera.h) has the focal lengths. All functions are safe to call from several threads at once. */
#ifndef PAGS_LENS_H
#define PAGS_LENS_H

#include <pags/base.h>

PAGS_BEGIN_C

/* The lens models. (x, y) = (X / Z, Y / Z), r is its distance from the axis, theta the angle from
 * the axis, up to pi. The formulas are those of OpenCV's manual and of COLMAP's documentation of its camera models
 * (https://colmap.github.io/cameras.html). Lenses of r see 85 degrees from the axis at most, those of theta beyond 90.
 */
typedef enum pags_lens_kind {
  PAGS_LENS_PERSPECTIVE, /* radial r_d = r (1 + k1 r^2 + ... + k4 r^8), then p1, p2 (OpenCV; k4: nerfstudio) */
  PAGS_LENS_FISHEYE,     /* theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8) (OpenCV's fisheye) */
  PAGS_LENS_RATIONAL,    /* as PERSPECTIVE, the radial part divided by 1 + d1 r^2 + d2 r^4 + d3 r^6 (FULL_OPENCV) */
  PAGS_LENS_FOV,         /* r_d = atan(2 r tan(omega / 2)) / omega, omega = k[0] (Devernay and Faugeras 2001) */
  PAGS_LENS_THIN_PRISM,  /* as PERSPECTIVE with a thin prism s[0] r^2, s[1] r^2, of (x, y) * theta / r (Weng 1992) */
  PAGS_LENS_ARIA,        /* six radial terms of theta; p and s[0..3] act on the result (Fisheye624 of Project Aria) */
  PAGS_LENS_DIVISION,    /* r = r_d / (1 + k[0] r_d^2) (Fitzgibbon 2001) */
  PAGS_LENS_EUCM,        /* r_d = r / (a sqrt(b r^2 + 1) + 1 - a), a = k[0], b = k[1] (Khomutenko et al. 2016) */
  /* theta_d = theta (1 + k1 theta + ... + k5 theta^5), then x_d = (1 + s[0]) x + s[1] y, y_d = s[2] x + y (F-theta: the
   * angle to radius polynomial of NVIDIA's cameras over its linear term, which is the focal length, and their c, d, e)
   */
  PAGS_LENS_FTHETA,
  /* x_d = atan2(X, Z), y_d = atan2(Y, |(X, Z)|): longitude and latitude; fx and fy are pixels a radian */
  PAGS_LENS_EQUIRECTANGULAR,
  PAGS_LENS_KINDS
} pags_lens_kind;

/* All zero: a pinhole without distortion. */
typedef struct pags_lens_model {
  pags_lens_kind kind;
  double k[6], d[3], p[2], s[4]; /* those that the kind doesn't name are 0 */
  double field; /* degrees across the circle that the lens sees, 0..360; nothing is seen beyond. 0: as far as it goes */
  double limit; /* angle from the axis, radians, up to which the kind is one to one; by pags_lens_model_check */
} pags_lens_model;

/* Whether the lens is a pinhole without distortion. */
PAGS_API int pags_lens_model_is_plain(const pags_lens_model *lens);

/* Whether two lenses are of one kind and have the same numbers and field, to 1e-9. */
PAGS_API int pags_lens_model_same(const pags_lens_model *a, const pags_lens_model *b);

/* Checks the numbers and computes `limit`. PAGS_ERROR_FORMAT; `what` names the lens in the message. */
PAGS_API pags_result pags_lens_model_check(pags_lens_model *lens, const char *what);

/* Half of `field` in radians, but at most `limit`: the largest angle from the axis that is seen. */
PAGS_API double pags_lens_model_widest(const pags_lens_model *lens);

/* The angle of a direction from the axis, 0..pi. */
PAGS_API double pags_lens_angle(const double direction[3]);

/* Where a direction of any length is seen: `at`, in focal lengths from the principal point, and, unless NULL, the
 * derivatives of at[0] and at[1] by the direction's coordinates, row by row. Defined within `limit`; an equirectangular
 * lens has no derivative at its poles. Z must be above 0 for lenses of r. */
PAGS_API void pags_lens_see(const pags_lens_model *lens, const double direction[3], double at[2], double jacobian[6]);

/* The unit direction of the picture position `at`. Returns 0 beyond the lens's widest angle, otherwise 1. The
 * iteration (Newton's, in the plane across the direction) begins at `direction` if that isn't zero: neighbouring pixels
 * make good starts. */
PAGS_API int pags_lens_look(const pags_lens_model *lens, const double at[2], double direction[3]);

/* The word for a kind in files, "fisheye"; NULL beyond the last one. */
PAGS_API const char *pags_lens_kind_name(pags_lens_kind kind);

PAGS_END_C
#endif
