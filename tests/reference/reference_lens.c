/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle's lenses: the formulas of pags/lens.h by angles, and derivatives by differences. Directions are found
 * by Newton's method in a plane whose distances are the angles from the axis. */
#include "reference/reference.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

int reference_has_lens(const pags_camera *camera) {
  const pags_lens_model *const l = &camera->lens;
  double size = 0;
  for (int k = 0; k < 6; k++)
    size += fabs(l->k[k]) + (k < 3 ? fabs(l->d[k]) : 0) + (k < 2 ? fabs(l->p[k]) : 0);
  return l->kind != PAGS_LENS_PERSPECTIVE || size > 0;
}

static int by_angle(pags_lens_kind kind) {
  return kind == PAGS_LENS_FISHEYE || kind == PAGS_LENS_THIN_PRISM || kind == PAGS_LENS_ARIA ||
         kind == PAGS_LENS_FTHETA || kind == PAGS_LENS_EQUIRECTANGULAR;
}

static double radius_of(const pags_lens_model *l, double s) {
  double sum = 1, below = 1;
  if (l->kind == PAGS_LENS_FTHETA) {
    for (int i = 0; i < 5; i++)
      sum += l->k[i] * pow(s, i + 1);
    return s * sum;
  }
  if (l->kind == PAGS_LENS_FOV)
    return atan(2 * s * tan(l->k[0] / 2)) / l->k[0];
  if (l->kind == PAGS_LENS_DIVISION) /* r = r_d / (1 + k r_d^2) */
    return fabs(l->k[0] * s) < 1e-12 ? s : (1 - sqrt(1 - 4 * l->k[0] * s * s)) / (2 * l->k[0] * s);
  if (l->kind == PAGS_LENS_EUCM)
    return s / (l->k[0] * sqrt(l->k[1] * s * s + 1) + 1 - l->k[0]);
  for (int i = 0; i < 6; i++)
    sum += l->k[i] * pow(s, 2 * i + 2);
  for (int i = 0; i < 3; i++)
    below += l->kind == PAGS_LENS_RATIONAL ? l->d[i] * pow(s, 2 * i + 2) : 0;
  return s * sum / below;
}

void reference_lens_pixel(const pags_camera *c, const double v[3], double pixel[2]) {
  const pags_lens_model *const l = &c->lens;
  const double aside = sqrt(v[0] * v[0] + v[1] * v[1]), length = sqrt(aside * aside + v[2] * v[2]);
  double x, y;
  if (l->kind == PAGS_LENS_EQUIRECTANGULAR) {
    x = atan2(v[0], v[2]);
    y = asin(v[1] / length);
  } else {
    const double theta = atan2(aside, v[2]), s = by_angle(l->kind) ? theta : tan(theta);
    const double ex = aside > 0 ? v[0] / aside : 1, ey = aside > 0 ? v[1] / aside : 0, r = radius_of(l, s);
    x = r * ex, y = r * ey;
    const double on = l->kind == PAGS_LENS_ARIA ? r : s, wx = on * ex, wy = on * ey, r2 = wx * wx + wy * wy;
    if (l->kind == PAGS_LENS_PERSPECTIVE || l->kind == PAGS_LENS_RATIONAL || l->kind == PAGS_LENS_THIN_PRISM ||
        l->kind == PAGS_LENS_ARIA) {
      x += 2 * l->p[0] * wx * wy + l->p[1] * (r2 + 2 * wx * wx);
      y += l->p[0] * (r2 + 2 * wy * wy) + 2 * l->p[1] * wx * wy;
    }
    if (l->kind == PAGS_LENS_THIN_PRISM)
      x += l->s[0] * r2, y += l->s[1] * r2;
    if (l->kind == PAGS_LENS_ARIA)
      x += l->s[0] * r2 + l->s[1] * r2 * r2, y += l->s[2] * r2 + l->s[3] * r2 * r2;
    if (l->kind == PAGS_LENS_FTHETA) {
      const double flat = x;
      x = (1 + l->s[0]) * flat + l->s[1] * y;
      y = l->s[2] * flat + y;
    }
  }
  pixel[0] = c->fx * x + c->cx;
  pixel[1] = c->fy * y + c->cy;
}

void reference_lens_jacobian(const pags_camera *c, const double v[3], double j[6]) {
  const double flat2 = v[0] * v[0] + v[2] * v[2]; /* small at the poles of longitude and latitude */
  const double h = 1e-3 * sqrt(flat2 + (c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 0 : v[1] * v[1]));
  for (int k = 0; k < 3; k++) {
    double around[4][2];
    for (int n = 0; n < 4; n++) {
      double w[3] = {v[0], v[1], v[2]};
      w[k] += h * (double)(n < 2 ? n - 2 : n - 1);
      reference_lens_pixel(c, w, around[n]);
    }
    for (int i = 0; i < 2; i++)
      j[3 * i + k] = (8 * (around[2][i] - around[1][i]) - (around[3][i] - around[0][i])) / (12 * h);
  }
}

static void direction_of(const double w[2], double v[3]) {
  const double angle = sqrt(w[0] * w[0] + w[1] * w[1]), scale = angle > 1e-9 ? sin(angle) / angle : 1;
  v[0] = scale * w[0], v[1] = scale * w[1], v[2] = cos(angle);
}

static double widest_of(const pags_camera *c) {
  const double most = c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? pi : by_angle(c->lens.kind) ? 3.1 : 85 * pi / 180;
  return c->lens.field > 0 ? fmin(most, c->lens.field / 2 * pi / 180) : most;
}

static int find_ray(const pags_camera *c, double x, double y, double v[3]) {
  double w[2] = {(x - c->cx) / c->fx, (y - c->cy) / c->fy};
  if (c->lens.kind == PAGS_LENS_EQUIRECTANGULAR) {
    v[0] = sin(w[0]) * cos(w[1]), v[1] = sin(w[1]), v[2] = cos(w[0]) * cos(w[1]);
    return fabs(w[0]) <= pi && fabs(w[1]) <= pi / 2 && acos(v[2]) <= widest_of(c);
  }
  const double radius = sqrt(w[0] * w[0] + w[1] * w[1]), widest = widest_of(c);
  if (radius > 0) { /* the radial part by bisection, as a start */
    double low = 0, high = widest;
    for (int i = 0; i < 50; i++) {
      const double middle = (low + high) / 2;
      if (radius_of(&c->lens, by_angle(c->lens.kind) ? middle : tan(middle)) < radius)
        low = middle;
      else
        high = middle;
    }
    w[0] *= low / radius, w[1] *= low / radius;
  }
  for (int i = 0; i < 30; i++) {
    const double h = 1e-6;
    double at[2], p[2], side[4];
    for (int k = 0; k < 2; k++) {
      double near[2] = {w[0] - (k ? 0 : h), w[1] - (k ? h : 0)}, far[2] = {w[0] + (k ? 0 : h), w[1] + (k ? h : 0)};
      double before[2], after[2];
      direction_of(near, v);
      reference_lens_pixel(c, v, before);
      direction_of(far, v);
      reference_lens_pixel(c, v, after);
      side[k] = (after[0] - before[0]) / (2 * h), side[2 + k] = (after[1] - before[1]) / (2 * h);
    }
    direction_of(w, v);
    reference_lens_pixel(c, v, p);
    at[0] = x - p[0], at[1] = y - p[1];
    if (fabs(at[0]) + fabs(at[1]) < 1e-9)
      break;
    const double all = side[0] * side[3] - side[1] * side[2];
    w[0] += (at[0] * side[3] - at[1] * side[1]) / all;
    w[1] += (side[0] * at[1] - side[2] * at[0]) / all;
    if (i == 29 || !(w[0] * w[0] + w[1] * w[1] < pi * pi))
      return 0;
  }
  return sqrt(w[0] * w[0] + w[1] * w[1]) <= widest;
}

/* The directions of the last camera's pixel centres are stored, since each render of a test needs them. Only for one
 * thread. */
int reference_lens_ray(const pags_camera *c, double x, double y, double v[3]) {
  static pags_camera last;
  static double *rays; /* three each, and whether it is seen */
  const int column = (int)floor(x), row = (int)floor(y);
  if (x != column + 0.5 || y != row + 0.5 || column < 0 || row < 0 || column >= c->width || row >= c->height)
    return find_ray(c, x, y, v);
  if (!rays || memcmp(&last.lens, &c->lens, sizeof last.lens) != 0 || last.width != c->width ||
      last.height != c->height || last.fx != c->fx || last.fy != c->fy || last.cx != c->cx || last.cy != c->cy) {
    free(rays);
    last = *c;
    rays = reference_alloc((int64_t)4 * c->width * c->height, sizeof *rays);
    for (int64_t i = 0; i < (int64_t)c->width * c->height; i++)
      rays[4 * i + 3] = find_ray(c, (double)(i % c->width) + 0.5, (double)(i / c->width) + 0.5, rays + 4 * i);
  }
  const double *const ray = rays + 4 * ((int64_t)row * c->width + column);
  memcpy(v, ray, 3 * sizeof *v);
  return ray[3] != 0;
}

reference_lens reference_lens_of(const pags_camera *c) {
  reference_lens l = {.is = reference_has_lens(c), .least = {INFINITY, INFINITY}, .most = {-INFINITY, -INFINITY}};
  double angle = 0;
  if (!l.is)
    return l;
  l.clamps = !by_angle(c->lens.kind);
  for (int i = 0; i < 64; i++) {
    const double a = i % 16 / 16.0;
    const double u[4] = {a, 1, 1 - a, 0}, v[4] = {0, a, 1, 1 - a};
    double ray[3];
    const double x = u[i / 16] * c->width, y = v[i / 16] * c->height, widest = widest_of(c);
    if (!reference_lens_ray(c, x, y, ray)) {
      const double w[2] = {x - c->cx, y - c->cy}, size = sqrt(w[0] * w[0] + w[1] * w[1]);
      direction_of((const double[2]){w[0] / size * widest, w[1] / size * widest}, ray);
    }
    angle = fmax(angle, acos(ray[2]));
    for (int k = 0; k < 2; k++) {
      l.least[k] = fmin(l.least[k], ray[k] / ray[2]);
      l.most[k] = fmax(l.most[k], ray[k] / ray[2]);
    }
  }
  for (int k = 0; k < 2; k++) {
    const double more = 0.15 * (l.most[k] - l.least[k]);
    l.least[k] -= more, l.most[k] += more;
  }
  pags_lens_model open = c->lens;
  open.field = 0;
  pags_camera whole = *c;
  whole.lens = open;
  l.farthest = c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? INFINITY : fmin(widest_of(&whole), angle + 0.35);
  l.turn = c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 2 * pi * c->fx : 0;
  return l;
}

/* Sigma points of the unscented transform (Julier and Uhlmann 1997) with alpha 1, beta 2 and kappa 0, the choice of Wu
 * et al. 2024: the mean and sqrt(3) sigma along each axis, of weights 0 (in the covariance 2) and 1/6. */
void reference_lens_sigma_points(const pags_camera *c, const double mean[3], const double axes[9], double pixel[2],
                                 double covariance[3]) {
  double points[7][2], middle[2] = {0, 0};
  for (int n = 0; n < 7; n++) {
    double p[3];
    for (int k = 0; k < 3; k++)
      p[k] = mean[k] + (n ? (n % 2 ? 1 : -1) * sqrt(3) * axes[3 * k + (n - 1) / 2] : 0);
    reference_lens_pixel(c, p, points[n]);
    for (int k = 0; k < 2; k++)
      middle[k] += n ? points[n][k] / 6 : 0;
  }
  memset(covariance, 0, 3 * sizeof *covariance);
  for (int n = 0; n < 7; n++) {
    const double x = points[n][0] - middle[0], y = points[n][1] - middle[1], w = n ? 1.0 / 6 : 2;
    covariance[0] += w * x * x, covariance[1] += w * x * y, covariance[2] += w * y * y;
  }
  memcpy(pixel, middle, sizeof middle);
}
