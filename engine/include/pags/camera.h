/* SPDX-License-Identifier: Apache-2.0 */
/* A pinhole camera without distortion, and camera and path files. */
#ifndef PAGS_CAMERA_H
#define PAGS_CAMERA_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_camera {
  int width, height;            /* pixels, 1..65535 */
  double fx, fy, cx, cy;        /* pixels; image corners at 0 and width/height */
  double world_from_camera[12]; /* 3x4 row-major [R|t], OpenCV axes, metres, absolute: the origin not subtracted */
  double time;                  /* seconds; NaN where unknown */
} pags_camera;

/* Checks sizes, focal lengths, that all numbers are finite and that R is a rotation within 1e-3 (it is then made
 * exactly orthonormal). `what` names the camera in the message. */
PAGS_API pags_result pags_camera_check(pags_camera *camera, const char *what);

/* The same camera at width/factor x height/factor pixels (rounded down, at least 1). Focal lengths and principal point
 * are divided by `factor` exactly: pixel (x, y) covers [x, x + 1] * factor of the source, what is left over at the
 * right and at the bottom is cut off. */
PAGS_API pags_camera pags_camera_downscale(const pags_camera *camera, double factor);

/* The check of the pose alone, for any 3x4 [R|t]. */
PAGS_API pags_result pags_rigid_check(double m[12], const char *what);
/* 3x4 [R|t] of the inverse rigid motion. */
PAGS_API void pags_rigid_inverse(const double m[12], double out[12]);
/* a * b for 3x4 rigid motions. */
PAGS_API void pags_rigid_multiply(const double a[12], const double b[12], double out[12]);
/* out = [R|t] p; not in place. */
PAGS_API void pags_rigid_point(const double m[12], const double p[3], double out[3]);
/* out = [Rz(yaw) Ry(pitch) Rx(roll) | place] of `turn` = roll, pitch, yaw, radians. */
PAGS_API void pags_rigid_from_angles(const double turn[3], const double place[3], double out[12]);
/* Rotation part (row-major 3x3) of a quaternion w x y z, normalised here; identity for a zero quaternion. */
PAGS_API void pags_rotation_from_quaternion(const double q[4], double r[9]);
/* The other way; w >= 0. */
PAGS_API void pags_quaternion_from_rotation(const double r[9], double q[4]);

/* One camera, or a path. A camera file is JSON: width height fx fy cx cy camera_from_world_quaternion_wxyz
 * camera_from_world_translation and optional time; a path file is {"fps": f, "frames": [camera, ...]}. */
typedef struct pags_camera_path {
  double fps; /* frames per second; 0 for a single camera */
  int64_t count;
  pags_camera *cameras; /* freed by pags_camera_path_destroy */
} pags_camera_path;

PAGS_API pags_result pags_camera_path_load(const char *path, pags_camera_path *out); /* either kind of file */
PAGS_API pags_result pags_camera_path_save(const char *path, const pags_camera_path *cameras);
PAGS_API void pags_camera_path_destroy(pags_camera_path *path);

#ifdef __cplusplus
}
#endif
#endif
