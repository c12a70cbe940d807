/* SPDX-License-Identifier: Apache-2.0 */
/* Rigid motions as 3x4 matrices, rotations as 3x3 matrices and quaternions, and checks and scaling of the pinhole
 * camera (pags/camera.h). All in double. */
#include <pags/camera.h>

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/file.h"
#include "base/vec3.h"
#include "maths/maths.h"

void pags_rigid_inverse(const double m[12], double out[12]) {
  double inverse[12];
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++)
      inverse[4 * i + j] = m[4 * j + i];
    inverse[4 * i + 3] = -(m[i] * m[3] + m[4 + i] * m[7] + m[8 + i] * m[11]);
  }
  memcpy(out, inverse, sizeof inverse);
}

void pags_rigid_multiply(const double a[12], const double b[12], double out[12]) {
  double product[12];
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 4; j++)
      product[4 * i + j] = a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] + a[4 * i + 2] * b[8 + j];
    product[4 * i + 3] += a[4 * i + 3];
  }
  memcpy(out, product, sizeof product);
}

void pags_rigid_point(const double m[12], const double p[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = pags_dot3(m + 4 * k, p) + m[4 * k + 3];
}

void pags_rigid_from_angles(const double turn[3], const double place[3], double out[12]) {
  const double cx = pags_cos(turn[0]), sx = pags_sin(turn[0]), cy = pags_cos(turn[1]), sy = pags_sin(turn[1]),
               cz = pags_cos(turn[2]), sz = pags_sin(turn[2]);
  const double m[3][4] = {{cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx, place[0]},
                          {sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx, place[1]},
                          {-sy, cy * sx, cy * cx, place[2]}};
  memcpy(out, m, sizeof m);
}

void pags_rotation_from_quaternion(const double quaternion[4], double r[9]) {
  const double *q = quaternion;
  double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), scaled[4];
  double w = 1, x = 0, y = 0, z = 0;
  if (norm < 1e-150 || norm > 1e150) { /* the squares leave the range of doubles */
    for (int k = 0; k < 4; k++)
      scaled[k] = quaternion[k] * (norm < 1 ? 0x1p600 : 0x1p-600);
    q = scaled;
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  }
  if (norm > 0)
    w = q[0] / norm, x = q[1] / norm, y = q[2] / norm, z = q[3] / norm;
  r[0] = 1 - 2 * (y * y + z * z);
  r[1] = 2 * (x * y - w * z);
  r[2] = 2 * (x * z + w * y);
  r[3] = 2 * (x * y + w * z);
  r[4] = 1 - 2 * (x * x + z * z);
  r[5] = 2 * (y * z - w * x);
  r[6] = 2 * (x * z - w * y);
  r[7] = 2 * (y * z + w * x);
  r[8] = 1 - 2 * (x * x + y * y);
}

/* Converts a rotation matrix to a quaternion (w, x, y, z) by the method of Shepperd 1978: the largest of the four
 * components is a square root and the others are quotients by it, so that nothing cancels. The sign is chosen such
 * that w >= 0. */
void pags_quaternion_from_rotation(const double r[9], double q[4]) {
  double trace = r[0] + r[4] + r[8];
  /* The squares are w^2 = (1 + trace) / 4 and q_k^2 = (1 + 2 r_kk - trace) / 4: these numbers have the same order. */
  double square[4] = {trace, r[0], r[4], r[8]};
  int largest = 0;
  for (int k = 1; k < 4; k++)
    if (square[k] > square[largest])
      largest = k;
  double sums[4] = {0, r[7] - r[5], r[2] - r[6], r[3] - r[1]}; /* 4 w x, 4 w y, 4 w z */
  double out[4];
  if (largest == 0) {
    double root = sqrt(1 + trace);
    out[0] = 0.5 * root;
    for (int k = 1; k < 4; k++)
      out[k] = 0.5 * sums[k] / root;
  } else {
    int i = largest - 1, j = (i + 1) % 3, k = (i + 2) % 3;
    double root = sqrt(1 + r[4 * i] - r[4 * j] - r[4 * k]);
    out[0] = 0.5 * sums[largest] / root;
    out[1 + i] = 0.5 * root;
    out[1 + j] = 0.5 * (r[3 * i + j] + r[3 * j + i]) / root;
    out[1 + k] = 0.5 * (r[3 * i + k] + r[3 * k + i]) / root;
  }
  double sign = out[0] < 0 ? -1 : 1;
  for (int k = 0; k < 4; k++)
    q[k] = sign * out[k];
}

/* Returns the largest absolute entry of R R^T - I, R the 3x3 part of m. */
static double orthonormal_error(const double m[12]) {
  double error = 0;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      error = fmax(error, fabs(pags_dot3(m + 4 * i, m + 4 * j) - (i == j)));
  return error;
}

/* Computes the 3x3 cofactor matrix c of the 3x3 part R of m, which is det(R) R^-T (for a rotation, R itself). Returns
 * det(R). */
static double cofactors(const double m[12], double c[9]) {
  for (int i = 0; i < 3; i++)
    pags_cross3(m + (i + 1) % 3 * 4, m + (i + 2) % 3 * 4, c + 3 * i);
  return pags_dot3(m, c);
}

/* Replaces the 3x3 part R of m by the nearest rotation: Newton's iteration for the polar factor, R <- (R + R^-T) / 2
 * (Higham 1986), which converges quadratically from an error of 1e-3. A matrix that is orthonormal to 1e-15 is not
 * changed, so that a camera keeps its bits however often it is checked. */
static void make_orthonormal(double m[12]) {
  for (int step = 0; step < 4 && orthonormal_error(m) > 1e-15; step++) {
    double c[9];
    double determinant = cofactors(m, c);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        m[4 * i + j] = 0.5 * (m[4 * i + j] + c[3 * i + j] / determinant);
  }
}

/* Largest entry of R R^T - I at which a pose is taken as rigid. */
static const double rigid_tolerance = 2e-3;

double pags_rigid_unscale(double m[12]) {
  double turned[12], squares = 0;
  for (int i = 0; i < 12; i++)
    squares += i % 4 == 3 ? 0 : m[i] * m[i];
  const double scale = sqrt(squares / 3);
  if (!(scale > 0 && isfinite(scale)) || orthonormal_error(m) <= rigid_tolerance)
    return 1;
  for (int i = 0; i < 12; i++)
    turned[i] = i % 4 == 3 ? m[i] : m[i] / scale;
  if (orthonormal_error(turned) > rigid_tolerance)
    return 1;
  memcpy(m, turned, sizeof turned);
  return scale;
}

static pags_result check_finite(const double m[12], const char *what) {
  for (int i = 0; i < 12; i++)
    if (!isfinite(m[i]))
      return pags_fail_at(what, "the pose is not finite");
  return PAGS_OK;
}

pags_result pags_rigid_check(double m[12], const char *what) {
  PAGS_TRY(check_finite(m, what));
  const double away = fmax(fmax(fabs(m[3]), fabs(m[7])), fabs(m[11]));
  if (away > 1e12)
    return pags_fail_at(what, "the pose is %.3g away; expected at most 1e12", away);
  double c[9], turned[12];
  const double error = orthonormal_error(m), volume = cofactors(m, c);
  memcpy(turned, m, sizeof turned);
  const double scale = pags_rigid_unscale(turned);
  if (scale != 1)
    return pags_fail_at(
        what, "the pose is not a rotation and a translation: it scales by %.6g; expected axes of length 1", scale);
  if (error > rigid_tolerance || volume < 0)
    return pags_fail_at(
        what, "the pose is not a rotation and a translation (%s)",
        error <= rigid_tolerance ? "it mirrors" : "its axes are not at right angles or differ in length");
  make_orthonormal(m);
  return PAGS_OK;
}

/* Largest error of R R^T at which a map counts as a rigid motion in double precision: a product of several has 1e-15.
 */
static const double rigid_error = 1e-9;

pags_result pags_affine_check(double m[12], const char *what) {
  PAGS_TRY(check_finite(m, what));
  double c[9];
  const double longest = pags_affine_stretch(m), volume = cofactors(m, c);
  if (!(fabs(volume) > 1e-9 * longest * longest * longest))
    return pags_fail_at(what, "the pose flattens what it moves: expected a scale other than 0 in every direction");
  if (volume > 0 && orthonormal_error(m) <= 2e-5) /* of R R^T: twice that of an entry */
    make_orthonormal(m);
  return PAGS_OK;
}

void pags_affine_inverse(const double m[12], double out[12]) {
  double c[9], inverse[12];
  if (orthonormal_error(m) < rigid_error && cofactors(m, c) > 0) {
    pags_rigid_inverse(m, out);
    return;
  }
  const double volume = cofactors(m, c);
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++)
      inverse[4 * i + j] = c[3 * j + i] / volume;
    inverse[4 * i + 3] = -(inverse[4 * i] * m[3] + inverse[4 * i + 1] * m[7] + inverse[4 * i + 2] * m[11]);
  }
  memcpy(out, inverse, sizeof inverse);
}

/* The square root of the largest sum of absolute values of a row of A A^T, which bounds its largest eigenvalue
 * (Gershgorin). */
double pags_affine_stretch(const double m[12]) {
  double most = 0;
  if (orthonormal_error(m) < rigid_error)
    return 1;
  for (int i = 0; i < 3; i++) {
    double sum = 0;
    for (int j = 0; j < 3; j++)
      sum += fabs(pags_dot3(m + 4 * i, m + 4 * j));
    most = fmax(most, sum);
  }
  return sqrt(most);
}

static const struct {
  const char *words;
  double across, down; /* sign */
} directions[] = {{"none", 0, 0},
                  {"top_to_bottom", 0, 1},
                  {"bottom_to_top", 0, -1},
                  {"left_to_right", 1, 0},
                  {"right_to_left", -1, 0}};
enum { DIRECTIONS = sizeof directions / sizeof *directions };

int pags_shutter_set(pags_shutter *shutter, const char *direction, double seconds) {
  for (int i = 0; i < DIRECTIONS; i++)
    if (strcmp(direction, directions[i].words) == 0) {
      shutter->across = directions[i].across != 0 ? directions[i].across * seconds : 0;
      shutter->down = directions[i].down != 0 ? directions[i].down * seconds : 0;
      return 1;
    }
  return 0;
}

const char *pags_shutter_direction(const pags_shutter *shutter) {
  for (int i = 1; i < DIRECTIONS; i++)
    if (directions[i].across * shutter->across > 0 || directions[i].down * shutter->down > 0)
      return directions[i].words;
  return directions[0].words;
}

pags_result pags_camera_check(pags_camera *camera, const char *what) {
  if (camera->width < 1 || camera->width > 65535 || camera->height < 1 || camera->height > 65535)
    return pags_fail_at(what, "expected a picture of 1 to 65535 pixels a side, found %d x %d", camera->width,
                        camera->height);
  if (!(camera->fx > 0 && camera->fy > 0 && isfinite(camera->fx) && isfinite(camera->fy)))
    return pags_fail_at(what, "expected positive focal lengths, found fx %g, fy %g", camera->fx, camera->fy);
  if (!isfinite(camera->cx) || !isfinite(camera->cy))
    return pags_fail_at(what, "expected a finite principal point, found cx %g, cy %g", camera->cx, camera->cy);
  const pags_shutter *const s = &camera->shutter;
  double speed = 0;
  for (int k = 0; k < 6; k++)
    speed += fabs(s->velocity[k]);
  if (!(fabs(s->across) <= 1 && fabs(s->down) <= 1 && (s->across == 0 || s->down == 0) && isfinite(speed)))
    return pags_fail_at(what,
                        "expected a rolling shutter that reads the picture across or down in at most 1 s, and a "
                        "finite velocity; found %g s across, %g s down and a velocity of %g",
                        s->across, s->down, speed);
  PAGS_TRY(pags_lens_model_check(&camera->lens, what));
  return pags_rigid_check(camera->world_from_camera, what);
}

int pags_camera_project(const pags_camera *camera, const double point[3], double pixel[2], double jacobian[6]) {
  double at[2];
  const double radians = pags_lens_angle(point);
  const bool seen = pags_camera_bends(camera) ? radians <= pags_lens_model_widest(&camera->lens) : point[2] > 0;
  if (!seen)
    return 0;
  pags_lens_see(&camera->lens, point, at, jacobian);
  pixel[0] = camera->fx * at[0] + camera->cx;
  pixel[1] = camera->fy * at[1] + camera->cy;
  for (int k = 0; k < 3 && jacobian; k++)
    jacobian[k] *= camera->fx, jacobian[3 + k] *= camera->fy;
  return 1;
}

int pags_camera_look(const pags_camera *camera, double x, double y, double direction[3]) {
  const double at[2] = {(x - camera->cx) / camera->fx, (y - camera->cy) / camera->fy};
  if (pags_camera_bends(camera)) {
    direction[0] = direction[1] = direction[2] = 0;
    return pags_lens_look(&camera->lens, at, direction);
  }
  direction[0] = at[0], direction[1] = at[1], direction[2] = 1;
  pags_divide3(direction, pags_length3(direction));
  return 1;
}

int pags_camera_point(const pags_camera *camera, double x, double y, double depth, double out[3]) {
  if (pags_camera_bends(camera)) {
    const int seen = pags_camera_look(camera, x, y, out);
    if (seen)
      pags_scale3(depth, out, out);
    return seen;
  }
  out[0] = (x - camera->cx) / camera->fx * depth;
  out[1] = (y - camera->cy) / camera->fy * depth;
  out[2] = depth;
  return 1;
}

pags_camera pags_camera_downscale(const pags_camera *camera, double factor) {
  pags_camera scaled = *camera;
  scaled.width = (int)fmax(floor((double)camera->width / factor), 1);
  scaled.height = (int)fmax(floor((double)camera->height / factor), 1);
  scaled.fx /= factor;
  scaled.fy /= factor;
  scaled.cx /= factor;
  scaled.cy /= factor;
  return scaled;
}
