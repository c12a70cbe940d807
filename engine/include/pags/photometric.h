/* SPDX-License-Identifier: Apache-2.0 */
/* Photometric calibration of a camera: vignetting (the lens is darker towards the corners) and the camera response (the
 * curve of the electronics). Both act on display-referred sRGB, alike on all three channels, before the gain and offset
 * of the exposure. All functions may be called from several threads at the same time. */
#ifndef PAGS_PHOTOMETRIC_H
#define PAGS_PHOTOMETRIC_H

#include <pags/base.h>
#include <pags/camera.h>

PAGS_BEGIN_C

enum { PAGS_VIGNETTING_RINGS = 4, PAGS_RESPONSE_PIECES = 6 };

/* Zeros: the identity. */
typedef struct pags_photometric {
  /* First, a value is multiplied by the vignetting factor, piecewise linear in the squared radius q (0 at the principal
   * point, 1 at the corner (0, 0) of the picture): 1 + vignette[i] at q = i / 3, extrapolated beyond q = 1. */
  double vignette[PAGS_VIGNETTING_RINGS];
  /* Then it passes the response, an ascending piecewise linear curve from (0, 0) to (1, 1) with the value
   * (i + 1) / 6 + response[i] at (i + 1) / 6. Values outside 0..1 are not changed. */
  double response[PAGS_RESPONSE_PIECES - 1];
} pags_photometric;

/* Deprecated names. */
#define pags_light pags_photometric
#define PAGS_LIGHT_RINGS PAGS_VIGNETTING_RINGS
#define PAGS_LIGHT_PIECES PAGS_RESPONSE_PIECES
#define pags_light_is_plain pags_photometric_is_identity
#define pags_light_is_sound pags_photometric_is_valid
#define pags_light_most pags_photometric_max_gain
#define pags_light_distance pags_photometric_radius2
#define pags_light_knot pags_photometric_curve_point
#define pags_light_vignette pags_photometric_vignetting
#define pags_light_response pags_photometric_response

/* Whether all numbers are 0. */
PAGS_API int pags_photometric_is_identity(const pags_photometric *calibration);
/* Whether all numbers are finite and the response ascends. */
PAGS_API int pags_photometric_is_valid(const pags_photometric *calibration);

/* An upper bound of the factor by which the difference of two values grows anywhere in a picture of `camera`. */
PAGS_API double pags_photometric_max_gain(const pags_photometric *calibration, const pags_camera *camera);

/* The squared radius q of the image position (x, y), pixels. */
static inline double pags_photometric_radius2(const pags_camera *camera, double x, double y) {
  const double u = x - camera->cx, v = y - camera->cy;
  return (u * u + v * v) / (camera->cx * camera->cx + camera->cy * camera->cy);
}

/* The response at i / 6, i from 0 to 6. */
PAGS_API double pags_photometric_curve_point(const pags_photometric *calibration, int i);
/* The vignetting factor at the squared radius `q`, at least 0.01. */
PAGS_API double pags_photometric_vignetting(const pags_photometric *calibration, double q);
/* The response at `value`; *slope (may be NULL): its derivative there. */
PAGS_API double pags_photometric_response(const pags_photometric *calibration, double value, double *slope);

PAGS_END_C
#endif
