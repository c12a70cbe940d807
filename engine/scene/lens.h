/* SPDX-License-Identifier: Apache-2.0 */
/* The lens of a photograph, as a data set describes it: intrinsics and a distortion model. Photographs are undistorted
 * when they are read; all later code uses the undistorted pinhole camera of pags_lens_pinhole. */
#ifndef PAGS_SCENE_LENS_H
#define PAGS_SCENE_LENS_H

#include <stdbool.h>

#include <pags/camera.h>

/* Whether the radial function takes the angle from the axis, radians; otherwise it takes the distance from the axis on
 * the plane z = 1. */
bool pags_lens_is_of_angle(pags_lens_kind kind);

/* The coefficients of r^2 and r^4 of the lens's prism, of x, then of y; 0 without one. */
void pags_lens_prism(const pags_lens_model *lens, double out[4]);

/* A lens with its picture; `limit` is that of the plane z = 1. */
typedef struct pags_lens {
  pags_lens_model model;
  int width, height;
  double fx, fy, cx, cy; /* pixels; the corners of the image lie at 0 and width or height */
  /* Squared radius on the plane z = 1 up to which the radial function grows and the lens sees; by pags_lens_prepare */
  double limit;
  bool folds; /* `limit` is where the radial function stops growing, nearer than 85 degrees; by pags_lens_prepare */
} pags_lens;

/* Checks the intrinsics, the size and the model, and computes the limits of both. `where` is put in front of an error
 * message. */
pags_result pags_lens_prepare(pags_lens *lens, const char *where);

/* Sets the intrinsics of a whole panorama of this size, px: the full turn across, from the zenith to the nadir. */
void pags_lens_set_panorama(double width, double height, pags_lens *lens);

/* Whether the lens has no distortion, so that its photographs need no resampling. */
bool pags_lens_is_pinhole(const pags_lens *lens);

/* Projects the point (x, y, 1) of the camera frame to the distorted pixel position (u, v). Returns false if the point
 * is beyond `limit`, where the distortion model is no longer one-to-one. */
bool pags_lens_project(const pags_lens *lens, double x, double y, double *u, double *v);

/* Projects a row of `count` points (x + i * step, y, 1): source[2 i] = u, source[2 i + 1] = v, both NaN beyond
 * `limit`. */
void pags_lens_project_row(const pags_lens *lens, int count, double x, double step, double y, double *source);

/* Fails if the lens can't be inverted at a tenth of the picture or more, so that its parameters can't be right.
 * *share: the part of the picture (0 to 1) at which it can't, which undistortion leaves out. */
pags_result pags_lens_check_inverse(const pags_lens *lens, const char *where, double *share);

/* Inverse projection: computes the point (x, y, 1) of the camera frame that projects to the distorted pixel position
 * (u, v); returns false if not found. */
bool pags_lens_unproject(const pags_lens *lens, double u, double v, double *x, double *y);

/* Computes the size and the intrinsics of the pinhole camera to which the pictures are resampled. The pinhole keeps
 * fx and fy, that is the resolution at the centre, and covers the largest upright rectangle inside the undistorted
 * borders, like COLMAP's undistorter with blank_pixels = 0. On each side it extends at most twice as far from the
 * principal point as the source does, because beyond that a wide lens only stretches the picture. The pose and the
 * time of `out` are not changed. */
pags_result pags_lens_pinhole(const pags_lens *lens, const char *where, pags_camera *out);

#endif
