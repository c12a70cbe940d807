/* SPDX-License-Identifier: Apache-2.0 */
/* A camera as a data set describes it: a pinhole with a distortion model. Everything past the reader works on the
 * pinhole it is brought to. */
#ifndef PAGS_DATASET_LENS_H
#define PAGS_DATASET_LENS_H

#include <stdbool.h>

#include <pags/camera.h>

typedef enum pags_lens_kind {
  PAGS_LENS_PERSPECTIVE, /* r_d = r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8), then p1, p2 (OpenCV, nerfstudio's k4) */
  PAGS_LENS_FISHEYE      /* theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8) (OpenCV's fisheye) */
} pags_lens_kind;

typedef struct pags_lens {
  pags_lens_kind kind;
  int width, height;
  double fx, fy, cx, cy; /* pixels; image corners at 0 and width/height */
  double k[4], p[2];
  double limit; /* squared radius on the plane z = 1 up to which the radial function grows; by pags_lens_prepare */
} pags_lens;

/* Checks the numbers and finds `limit`. `where` begins the message. */
pags_result pags_lens_prepare(pags_lens *lens, const char *where);

/* No distortion at all: pictures are used as they are. */
bool pags_lens_is_pinhole(const pags_lens *lens);

/* Source pixel position of (x, y, 1) in the camera's frame. Says false past the limit, where the model folds back. */
bool pags_lens_project(const pags_lens *lens, double x, double y, double *u, double *v);

/* The same for a row of `count` points (x + i * step, y, 1): source[2 i] = u, source[2 i + 1] = v, both NaN past the
 * limit. */
void pags_lens_project_row(const pags_lens *lens, int count, double x, double step, double y, double *source);

/* The inverse: (x, y) on the plane z = 1 of a source pixel position; false where there is none. */
bool pags_lens_unproject(const pags_lens *lens, double u, double v, double *x, double *y);

/* Size and intrinsics of the pinhole that the pictures are resampled to. It keeps fx and fy (the resolution at the
 * centre) and is the largest upright rectangle within the undistorted borders, as COLMAP's undistorter chooses with
 * blank_pixels = 0; never beyond twice the source's extent from the principal point on any side, where wide lenses only
 * stretch. Pose and time of `out` are left alone. */
pags_result pags_lens_pinhole(const pags_lens *lens, const char *where, pags_camera *out);

#endif
