/* SPDX-License-Identifier: Apache-2.0 */
/* A camera: a pinhole or a lens, with a global or a rolling shutter; rigid motions and rotations, and the JSON files
 * that hold one camera or a path of cameras. All functions are safe to call from several threads at once. */
#ifndef PAGS_CAMERA_H
#define PAGS_CAMERA_H

#include <pags/base.h>
#include <pags/lens.h>

PAGS_BEGIN_C

/* A rolling shutter: the lines of the picture are read one after another while the camera moves. The camera's pose is
 * that of the middle of the exposure, when the line in the middle of the picture is read. */
typedef struct pags_shutter {
  /* Read-out: seconds from the left edge of the picture to the right one, or from the top to the bottom; negative the
   * other way round. One of them is 0; both: a global shutter, all pixels are read at once. */
  double across, down;
  /* Motion during read-out: t seconds after the middle the pose is world_from_camera * [Exp(t w) | t v]; w, radians/s,
   * is velocity[0..2] and v, metres/s, velocity[3..5], both in the camera's frame. */
  double velocity[6];
} pags_shutter;

typedef struct pags_camera {
  int width, height;     /* pixels, 1..65535 */
  double fx, fy, cx, cy; /* focal lengths and principal point, pixels; the image's edges lie at 0 and width/height */
  /* 3x4 row-major [R|t], OpenCV axes, metres, in absolute world coordinates: the scene's origin is not
   * subtracted. */
  double world_from_camera[12];
  double time;          /* seconds; NaN if unknown */
  pags_shutter shutter; /* all 0: global */
  /* All 0: a pinhole. The depth of a camera with a lens is the distance from its centre, metres, that of a pinhole the
   * coordinate along its axis. Its near plane is a sphere. Nothing is drawn outside of the circle that the lens sees.
   */
  pags_lens_model lens;
} pags_camera;

/* Whether the camera has a lens other than a pinhole. */
static inline int pags_camera_bends(const pags_camera *camera) {
  return !pags_lens_model_is_plain(&camera->lens);
}

/* Projects a point of the camera's frame to `pixel`, which may lie outside the picture, with the derivatives by the
 * point unless `jacobian` is NULL, row by row. Returns 0 if the lens doesn't see the point, or if it lies behind the
 * plane z = 0 of a pinhole. The camera must have passed pags_camera_check. */
PAGS_API int pags_camera_project(const pags_camera *camera, const double point[3], double pixel[2], double jacobian[6]);

/* The unit direction, in the camera's frame, of the pixel position (x, y). Returns 0 if the lens sees nothing there.
 * The camera must have passed pags_camera_check. */
PAGS_API int pags_camera_look(const pags_camera *camera, double x, double y, double direction[3]);

/* Computes the point, in the camera's frame, at the pixel position (x, y) and this depth in metres: the coordinate
 * along the axis of a pinhole, the distance from a camera with a lens. Returns 0, without a point, if the lens sees
 * nothing there. */
PAGS_API int pags_camera_point(const pags_camera *camera, double x, double y, double depth, double out[3]);

/* Whether the camera has a rolling shutter. */
static inline int pags_camera_rolls(const pags_camera *camera) {
  return camera->shutter.across != 0.0 || camera->shutter.down != 0.0;
}

/* Seconds from the middle of the exposure to when the pixel at (x, y), px, is read; 0 with a global shutter. */
static inline double pags_camera_read_at(const pags_camera *camera, double x, double y) {
  return camera->shutter.across * (x / camera->width - 0.5) + camera->shutter.down * (y / camera->height - 0.5);
}

/* Computes the position of a static point in the camera's frame at the moment when its line is read. `middle`: its
 * position in the middle of the exposure. `out` may be `middle`. */
PAGS_API void pags_camera_see(const pags_camera *camera, const double middle[3], double out[3]);

/* Sets the read-out from its direction, "top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left" or "none",
 * and its seconds; the velocity stays. Returns 0, with `shutter` unchanged, for other directions, otherwise 1. */
PAGS_API int pags_shutter_set(pags_shutter *shutter, const char *direction, double seconds);

/* Returns the direction in these words, a static string. */
PAGS_API const char *pags_shutter_direction(const pags_shutter *shutter);

/* Checks the size (1..65535 pixels a side), that the focal lengths are positive and finite, that the principal
 * point is finite, that a rolling shutter reads in one direction, in at most a second and with a finite velocity, the
 * lens as pags_lens_model_check does, and the pose as pags_rigid_check does, which also makes R exactly orthonormal.
 * Returns PAGS_ERROR_FORMAT if a check fails; `what` names the camera in the message. */
PAGS_API pags_result pags_camera_check(pags_camera *camera, const char *what);

/* Returns the same camera at width/factor x height/factor pixels (rounded down, at least 1); factor >= 1. Focal
 * lengths and principal point are divided by `factor` exactly: pixel x covers [x, x + 1] * factor of the source
 * pixels. The remainder at the right and bottom edges of the source, which fills no whole pixel, is cut off. */
PAGS_API pags_camera pags_camera_downscale(const pags_camera *camera, double factor);

/* Checks that a 3x4 [R|t] is finite, t at most 1e12 on each axis, and that R is a rotation: about 1e-3 off in each
 * entry is accepted (R R^T within 2e-3 of the identity, determinant positive). R is then replaced by the nearest
 * rotation (Newton's iteration for the polar factor, Higham 1986); an R that is orthonormal already keeps its bits.
 * Returns PAGS_ERROR_FORMAT otherwise; `what` names the pose in the message. */
PAGS_API pags_result pags_rigid_check(double m[12], const char *what);

/* Divides the 3x3 part of a pose by its uniform scale, where it has one that pags_rigid_check would refuse, and returns
 * that scale. Returns 1, with `m` unchanged, where it has none or where its axes would not be orthonormal. */
PAGS_API double pags_rigid_unscale(double m[12]);

/* Moves a pose at a constant velocity, out = m [Exp(t w) | t v] with (w, v) = velocity, as pags_shutter has it. `out`
 * may be `m`. */
PAGS_API void pags_rigid_move(const double m[12], const double velocity[6], double seconds, double out[12]);

/* Computes the velocity (w, v), in the frame of a pose `m` between them, at which a moves to b in `seconds` > 0. */
PAGS_API void pags_rigid_velocity(const double a[12], const double m[12], const double b[12], double seconds,
                                  double velocity[6]);

/* Computes the inverse [R^T | -R^T t] of a rigid motion [R|t]. `out` may be `m`. */
PAGS_API void pags_rigid_inverse(const double m[12], double out[12]);

/* out = a * b for two 3x4 rigid motions or affine maps: b is applied first. `out` may be `a` or `b`. */
PAGS_API void pags_rigid_multiply(const double a[12], const double b[12], double out[12]);

/* out = R p + t for the rigid motion m = [R|t]. `out` must not be `p`. */
PAGS_API void pags_rigid_point(const double m[12], const double p[3], double out[3]);

/* Checks that a 3x4 [A|t], which may turn, scale, stretch and mirror, is finite and that A can be inverted: |det A| is
 * more than 1e-9 of the cube of its stretch. A rotation within 1e-5 (float rounding) is made exact as pags_rigid_check
 * does. Returns PAGS_ERROR_FORMAT if the check fails; `what` names the pose in the message. */
PAGS_API pags_result pags_affine_check(double m[12], const char *what);

/* Computes the inverse of an affine map that has passed pags_affine_check; of a rigid motion, with the bits of
 * pags_rigid_inverse. `out` may be `m`. */
PAGS_API void pags_affine_inverse(const double m[12], double out[12]);

/* Returns an upper bound of the factor by which the map lengthens a vector: exactly 1 for a rigid motion, s for one
 * that scales by s, at most 1.7 times the largest stretch for any other. */
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
 * camera_from_world_quaternion_wxyz, camera_from_world_translation and, optionally, time, rolling_shutter, an object
 * with the members direction, seconds and velocity (6 numbers), and lens, one with the members kind
 * (pags_lens_kind_name) and, where they aren't 0, k (6 numbers), d (3), p (2), s (4) and field (degrees). A path file
 * is {"fps": f, "frames": [camera, ...]} with f > 0 and at least one frame. */
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

PAGS_END_C
#endif
