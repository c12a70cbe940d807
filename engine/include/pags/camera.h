/* SPDX-License-Identifier: Apache-2.0 */
/* A pinhole camera without distortion, rigid motions and rotations, and the JSON files that hold one camera or a
 * path of cameras. All functions are safe to call from several threads at once. */
#ifndef PAGS_CAMERA_H
#define PAGS_CAMERA_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_camera {
  int width, height;     /* pixels, 1..65535 */
  double fx, fy, cx, cy; /* focal lengths and principal point, pixels; the image's edges lie at 0 and width/height */
  /* 3x4 row-major [R|t], OpenCV axes, metres, in absolute world coordinates: the scene's origin is not
   * subtracted. */
  double world_from_camera[12];
  double time; /* seconds; NaN if unknown */
} pags_camera;

/* Checks the size (1..65535 pixels a side), that the focal lengths are positive and finite, that the principal
 * point is finite, and the pose as pags_rigid_check does, which also makes R exactly orthonormal. Returns
 * PAGS_ERROR_FORMAT if a check fails; `what` names the camera in the message. */
PAGS_API pags_result pags_camera_check(pags_camera *camera, const char *what);

/* Returns the same camera at width/factor x height/factor pixels (rounded down, at least 1); factor >= 1. Focal
 * lengths and principal point are divided by `factor` exactly: pixel x covers [x, x + 1] * factor of the source
 * pixels. The remainder at the right and bottom edges of the source, which fills no whole pixel, is cut off. */
PAGS_API pags_camera pags_camera_downscale(const pags_camera *camera, double factor);

/* Checks that a 3x4 [R|t] is finite and that R is a rotation: about 1e-3 off in each entry is accepted (R R^T
 * within 2e-3 of the identity, determinant positive). R is then replaced by the nearest rotation (Newton's
 * iteration for the polar factor, Higham 1986); an R that is orthonormal already keeps its bits. Returns
 * PAGS_ERROR_FORMAT otherwise; `what` names the pose in the message. */
PAGS_API pags_result pags_rigid_check(double m[12], const char *what);

/* Computes the inverse [R^T | -R^T t] of a rigid motion [R|t]. `out` may be `m`. */
PAGS_API void pags_rigid_inverse(const double m[12], double out[12]);

/* out = a * b for two 3x4 rigid motions or affine maps: b is applied first. `out` may be `a` or `b`. */
PAGS_API void pags_rigid_multiply(const double a[12], const double b[12], double out[12]);

/* out = R p + t for the rigid motion m = [R|t]. `out` must not be `p`. */
PAGS_API void pags_rigid_point(const double m[12], const double p[3], double out[3]);

/* Checks that a 3x4 [A|t], which may turn, scale, stretch and mirror, is finite and that A can be inverted: |det A| is
 * more than 1e-9 of the cube of its stretch. A rotation that is off by no more than 1e-5, the rounding of floats,
 * is made exact as pags_rigid_check does. Returns PAGS_ERROR_FORMAT if the check fails; `what` names the pose in the
 * message. */
PAGS_API pags_result pags_affine_check(double m[12], const char *what);

/* Computes the inverse of an affine map that has passed pags_affine_check; of a rigid motion, with the bits of
 * pags_rigid_inverse. `out` may be `m`. */
PAGS_API void pags_affine_inverse(const double m[12], double out[12]);

/* Returns a factor by which the map lengthens no vector by more: exactly 1 for a rigid motion, s for one that scales by
 * s, at most 1.7 times the largest stretch for any other. */
PAGS_API double pags_affine_stretch(const double m[12]);

/* Computes out = [Rz(yaw) Ry(pitch) Rx(roll) | place] from turn = (roll, pitch, yaw) in radians. */
PAGS_API void pags_rigid_from_angles(const double turn[3], const double place[3], double out[12]);

/* Computes the rotation matrix (row-major 3x3) of a quaternion (w, x, y, z), which may have any length. The zero
 * quaternion gives the identity. */
PAGS_API void pags_rotation_from_quaternion(const double q[4], double r[9]);

/* Computes the unit quaternion (w, x, y, z), w >= 0, of a rotation matrix (row-major 3x3), by the method of
 * Shepperd 1978. */
PAGS_API void pags_quaternion_from_rotation(const double r[9], double q[4]);

/* One camera or a path of cameras. A camera file is a JSON object with the members width, height, fx, fy, cx, cy,
 * camera_from_world_quaternion_wxyz, camera_from_world_translation and, optionally, time. A path file is {"fps":
 * f, "frames": [camera, ...]} with f > 0 and at least one frame. */
typedef struct pags_camera_path {
  double fps; /* frames per second; 0 for a single camera */
  int64_t count;
  pags_camera *cameras; /* `count` cameras, freed by pags_camera_path_destroy */
} pags_camera_path;

/* Reads a camera file or a path file, also cameras.json of INRIA's train.py (fps 30) or a camera path of nerfstudio,
 * and checks each camera. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (the message names the file and the line), PAGS_ERROR_LIMIT
 * (JSON nested too deeply) or PAGS_ERROR_MEMORY; then `out` is empty. */
PAGS_API pags_result pags_camera_path_load(const char *path, pags_camera_path *out);

/* Writes a path file if fps > 0, otherwise a camera file, for which `count` must be 1. PAGS_ERROR_IO or
 * PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_camera_path_save(const char *path, const pags_camera_path *cameras);

/* Frees the cameras and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_camera_path_destroy(pags_camera_path *path);

#ifdef __cplusplus
}
#endif
#endif
