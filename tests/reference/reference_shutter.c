/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle's rolling shutter: poses at a time by Rodrigues' formula, the read-out time of the line that shows a
 * mean by bisection, and the mean's velocity from the derivatives of the poses. */
#include "reference/reference.h"

#include <math.h>
#include <string.h>

/* pose * [Exp(t w) | t v] */
static void move(double pose[12], const double velocity[6], double t) {
  const double w[3] = {t * velocity[0], t * velocity[1], t * velocity[2]};
  const double angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  const double s = angle > 1e-9 ? sin(angle) / angle : 1, half = sin(0.5 * angle);
  const double c = angle > 1e-9 ? 2 * half * half / (angle * angle) : 0.5;
  const double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0};
  double turn[9], out[12];
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) {
      turn[3 * row + column] = (row == column) + s * k[3 * row + column];
      for (int j = 0; j < 3; j++)
        turn[3 * row + column] += c * k[3 * row + j] * k[3 * j + column];
    }
  }
  for (int row = 0; row < 3; row++) {
    out[4 * row + 3] = pose[4 * row + 3];
    for (int column = 0; column < 3; column++) {
      out[4 * row + column] = 0;
      for (int j = 0; j < 3; j++)
        out[4 * row + column] += pose[4 * row + j] * turn[3 * j + column];
      out[4 * row + 3] += pose[4 * row + column] * t * velocity[3 + column];
    }
  }
  memcpy(pose, out, sizeof out);
}

reference_moment reference_moment_at(const reference_part *part, const pags_camera *camera, double seconds) {
  reference_moment moment = {*part, *camera};
  move(moment.part.world_from_model, part->velocity, seconds);
  move(moment.camera.world_from_camera, camera->shutter.velocity, seconds);
  moment.camera.shutter = (pags_shutter){0};
  return moment;
}

/* A mean at a time: its camera coordinates, the pixel, and their derivatives by time. */
typedef struct passing {
  double at[3], rate[3], pixel[2], drift[2];
  double read; /* when the line through the pixel is read, seconds */
} passing;

static void cross(const double a[3], const double b[3], double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/* R v of a pose [R|t]. */
static void turn(const double pose[12], const double v[3], double out[3]) {
  for (int row = 0; row < 3; row++)
    out[row] = pose[4 * row] * v[0] + pose[4 * row + 1] * v[1] + pose[4 * row + 2] * v[2];
}

/* p_world = R (Exp(t w) p + t v) + T with the derivative R (Exp(t w) (w x p) + v). The camera's point is C' (p_world -
 * c) with C = C_0 Exp(t w_c): its derivative is C' (p_world' - c') - w_c x point. */
static passing pass_plane(const reference_part *part, int64_t i, const pags_camera *camera,
                          const pags_frame_options *options, double seconds) {
  const reference_moment moment = reference_moment_at(part, camera, seconds);
  const reference_view view = reference_view_of(&moment.part, &moment.camera, options);
  const double mean[3] = {reference_value(part, PAGS_MEAN, i), reference_value(part, PAGS_MEAN + 1, i),
                          reference_value(part, PAGS_MEAN + 2, i)};
  double spin[3], world[3], push[3], pull[3], turned[3];
  passing p;
  cross(part->velocity, mean, spin);
  turn(moment.part.world_from_model, spin, world);
  turn(part->world_from_model, part->velocity + 3, push);
  turn(camera->world_from_camera, camera->shutter.velocity + 3, pull);
  for (int k = 0; k < 3; k++) {
    p.at[k] = view.translation[k];
    p.rate[k] = 0;
    for (int j = 0; j < 3; j++) {
      p.at[k] += view.rotation[3 * k + j] * mean[j];
      p.rate[k] += moment.camera.world_from_camera[4 * j + k] * (world[j] + push[j] - pull[j]);
    }
  }
  cross(camera->shutter.velocity, p.at, turned);
  const double f[2] = {camera->fx, camera->fy}, c[2] = {camera->cx, camera->cy};
  for (int k = 0; k < 3; k++)
    p.rate[k] -= turned[k];
  for (int k = 0; k < 2; k++) {
    p.pixel[k] = f[k] * p.at[k] / p.at[2] + c[k];
    p.drift[k] = f[k] * (p.rate[k] - p.at[k] / p.at[2] * p.rate[2]) / p.at[2];
  }
  p.read = pags_camera_read_at(camera, p.pixel[0], p.pixel[1]);
  return p;
}

/* The same through a lens. Longitudes are at most half a turn from that of the middle of the exposure. */
static passing pass(const reference_part *part, int64_t i, const pags_camera *camera, const pags_frame_options *options,
                    double seconds) {
  passing p = pass_plane(part, i, camera, options, seconds);
  double j[6], middle[2];
  if (!reference_has_lens(camera))
    return p;
  const double turn = camera->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 6.283185307179586 * camera->fx : 0;
  reference_lens_pixel(camera, p.at, p.pixel);
  reference_lens_jacobian(camera, p.at, j);
  for (int k = 0; k < 2; k++)
    p.drift[k] = j[3 * k] * p.rate[0] + j[3 * k + 1] * p.rate[1] + j[3 * k + 2] * p.rate[2];
  if (turn > 0) {
    reference_lens_pixel(camera, pass_plane(part, i, camera, options, 0).at, middle);
    p.pixel[0] -= turn * round((p.pixel[0] - middle[0]) / turn);
  }
  p.read = pags_camera_read_at(camera, p.pixel[0], p.pixel[1]);
  return p;
}

reference_line reference_find_line(const reference_part *part, int64_t i, const pags_camera *camera,
                                   const pags_frame_options *options) {
  const double most =
      fabs(camera->shutter.across + camera->shutter.down); /* half a read-out beyond either edge of the picture */
  const double s[2] = {camera->shutter.across / camera->width, camera->shutter.down / camera->height};
  double lo = -most, hi = most;
  if (pass(part, i, camera, options, hi).read >= hi)
    lo = hi;
  if (lo < hi && pass(part, i, camera, options, lo).read <= lo)
    hi = lo;
  const bool clamped = lo == hi;
  for (int step = 0; step < 80 && lo < hi; step++) {
    const double middle = 0.5 * (lo + hi);
    if (pass(part, i, camera, options, middle).read > middle)
      lo = middle;
    else
      hi = middle;
  }
  const passing p = pass(part, i, camera, options, hi);
  const double q = 1 - s[0] * p.drift[0] - s[1] * p.drift[1];
  reference_line line = {.seconds = hi, .seen = hi, .shear = {1, 0, 0, 1}};
  const double moves = fabs(s[0] + s[1]) * (fabs(p.drift[0]) + fabs(p.drift[1])); /* px a line */
  line.margin = fmin(fmin(fabs(q / 0.1 - 1), fabs(moves - 1)), fabs(fabs(p.read) / most - 1));
  if (!(q >= 0.1 && moves <= 1)) {
    const double read = pass(part, i, camera, options, 0).read;
    line.held = true;
    line.seconds = 0;
    line.seen = fmin(fmax(read, -most), most);
  } else if (!clamped) {
    for (int k = 0; k < 4; k++)
      line.shear[k] += p.drift[k / 2] * s[k % 2] / q;
  }
  return line;
}
