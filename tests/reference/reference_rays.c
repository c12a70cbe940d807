/* SPDX-License-Identifier: Apache-2.0 */
/* The exact counterpart of the affine projection: the largest value of each Gaussian along the ray through a pixel's
 * centre, in double.
 *
 * With S the covariance in camera axes, m the mean and d the ray, the value at t d is exp(-(t d - m)' S^-1 (t d - m)
 * / 2); it is largest at t = d' S^-1 m / d' S^-1 d. The integral along the ray is that value times a factor that
 * doesn't depend on how far from the mean the ray passes. The low-pass filter widens S by low_pass (z / f)^2 across
 * the picture's axes, whose affine image is low_pass I. With a lens it widens S by low_pass J+ J+', J+ = J' (J J')^-1,
 * whose affine image is the same, and rays go where the lens looks. */
#include "reference/reference.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct ray_splat {
  double s[6]; /* S: xx xy xz yy yz zz */
  double q[6]; /* its inverse */
  double qm[3], mqm;
  double limit; /* largest squared Mahalanobis distance that is drawn */
} ray_splat;

static int find_inverse(ray_splat *r, const double m[3]) {
  const double xx = r->s[0], xy = r->s[1], xz = r->s[2], yy = r->s[3], yz = r->s[4], zz = r->s[5];
  const double a = yy * zz - yz * yz, b = xz * yz - xy * zz, c = xy * yz - xz * yy, det = xx * a + xy * b + xz * c;
  if (!(det > 0) || !isfinite(det))
    return 0;
  const double q[6] = {
      a / det, b / det, c / det, (xx * zz - xz * xz) / det, (xy * xz - xx * yz) / det, (xx * yy - xy * xy) / det};
  memcpy(r->q, q, sizeof q);
  r->qm[0] = q[0] * m[0] + q[1] * m[1] + q[2] * m[2];
  r->qm[1] = q[1] * m[0] + q[3] * m[1] + q[4] * m[2];
  r->qm[2] = q[2] * m[0] + q[4] * m[1] + q[5] * m[2];
  r->mqm = m[0] * r->qm[0] + m[1] * r->qm[1] + m[2] * r->qm[2];
  return 1;
}

static int find_ray_splat(const reference_part *part, int64_t i, const reference_view *view, const pags_camera *camera,
                          double low_pass, double least, const reference_splat *splat, ray_splat *out) {
  reference_splat spare = *splat;
  const reference_projection p = reference_project(part, i, view, camera, &spare);
  double axes[9] = {0};
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++)
      for (int k = 0; k < 3; k++)
        axes[3 * row + column] += view->rotation[3 * row + k] * p.rotation[3 * k + column] * p.sigma[column];
  static const int rows[6] = {0, 0, 0, 1, 1, 2}, columns[6] = {0, 1, 2, 1, 2, 2};
  for (int e = 0; e < 6; e++) {
    out->s[e] = 0;
    for (int k = 0; k < 3; k++)
      out->s[e] += axes[3 * rows[e] + k] * axes[3 * columns[e] + k];
  }
  if (view->lens.is) {
    double j[6], wide[6];
    reference_lens_jacobian(camera, splat->camera, j);
    const double a = j[0] * j[0] + j[1] * j[1] + j[2] * j[2], b = j[0] * j[3] + j[1] * j[4] + j[2] * j[5],
                 c = j[3] * j[3] + j[4] * j[4] + j[5] * j[5], all = a * c - b * b;
    for (int k = 0; k < 3; k++)
      wide[2 * k] = (c * j[k] - b * j[3 + k]) / all, wide[2 * k + 1] = (a * j[3 + k] - b * j[k]) / all;
    for (int e = 0; e < 6; e++)
      out->s[e] +=
          low_pass * (wide[2 * rows[e]] * wide[2 * columns[e]] + wide[2 * rows[e] + 1] * wide[2 * columns[e] + 1]);
  } else {
    const double x = splat->camera[2] / camera->fx, y = splat->camera[2] / camera->fy;
    out->s[0] += low_pass * x * x;
    out->s[3] += low_pass * y * y;
  }
  out->limit = 2 * log(splat->opacity / least);
  return find_inverse(out, splat->camera);
}

/* Finds the pixels [first, end) of `size` along an axis that may see the Gaussian: the slopes at which a plane
 * through the eye touches the ellipsoid of the largest distance; all pixels if the ellipsoid reaches the plane z = 0
 * of the eye. */
static void find_span(double mean, double z, double s_aa, double s_az, double s_zz, double limit, double f, double c,
                      int size, int *first, int *end) {
  const double a = z * z - limit * s_zz, b = mean * z - limit * s_az, d = b * b - a * (mean * mean - limit * s_aa);
  *first = 0, *end = size;
  if (a <= 0 || d < 0)
    return;
  const double lo = f * (b - sqrt(d)) / a + c, hi = f * (b + sqrt(d)) / a + c;
  *first = (int)fmin(size, fmax(0, floor(lo - 1)));
  *end = (int)fmin(size, fmax(0, ceil(hi + 1)));
}

static double ray_distance(const ray_splat *r, const double ray[3]) {
  const double *q = r->q, x = ray[0], y = ray[1], z = ray[2];
  const double dqm = x * r->qm[0] + y * r->qm[1] + z * r->qm[2];
  const double dqd =
      q[0] * x * x + 2 * q[1] * x * y + 2 * q[2] * x * z + q[3] * y * y + 2 * q[4] * y * z + q[5] * z * z;
  return dqm > 0 ? r->mqm - dqm * dqm / dqd : INFINITY; /* the largest value lies behind the eye: not seen */
}

typedef struct ray_picture {
  double *rgb, *transmittance;
  uint8_t *stopped;
  double *rays; /* directions of each pixel; 0, 0, 0: the pixel sees nothing */
} ray_picture;

static void blend_ray(const reference_picture *from, const reference_splat *splat, double distance, int64_t pixel,
                      ray_picture *out) {
  const double whole = splat->opacity * exp(-0.5 * distance);
  const double alpha = fmin(from->limits.alpha_cap, splat->gain * whole - splat->floor);
  const double before = out->transmittance[pixel], after = before * (1 - alpha);
  if (whole < splat->least)
    return;
  if (after < from->limits.stop) {
    out->stopped[pixel] = 1;
    return;
  }
  for (int c = 0; c < 3; c++)
    out->rgb[c * (int64_t)from->width * from->height + pixel] += alpha * before * splat->colour[c];
  out->transmittance[pixel] = after;
}

static void blend_splat(const reference_picture *from, const reference_splat *splat, const ray_splat *ray,
                        const pags_camera *camera, ray_picture *out) {
  const double *m = splat->camera, *s = ray->s;
  int x0 = 0, x1 = from->width, y0 = 0, y1 = from->height;
  const int lens = reference_has_lens(camera);
  if (!lens)
    find_span(m[0], m[2], s[0], s[2], s[5], ray->limit, camera->fx, camera->cx, from->width, &x0, &x1);
  if (!lens)
    find_span(m[1], m[2], s[3], s[4], s[5], ray->limit, camera->fy, camera->cy, from->height, &y0, &y1);
  for (int y = y0; y < y1; y++)
    for (int x = x0; x < x1; x++) {
      const int64_t pixel = (int64_t)y * from->width + x;
      if (!out->stopped[pixel])
        blend_ray(from, splat, ray_distance(ray, out->rays + 3 * pixel), pixel, out);
    }
}

/* Returns the part to which the Gaussian belongs, by its index over all parts; `row` receives its row in that part. */
static int part_of(const reference_part *parts, int64_t gaussian, int64_t *row) {
  int p = 0;
  for (*row = gaussian; *row >= parts[p].count; p++)
    *row -= parts[p].count;
  return p;
}

double *reference_ray_picture(const reference_part *parts, int part_count, const pags_camera *camera,
                              const pags_frame_options *options, const reference_picture *from) {
  const int64_t pixels = (int64_t)from->width * from->height;
  int64_t *order = reference_alloc(from->splat_count, sizeof *order), row;
  reference_view *views = reference_alloc(part_count, sizeof *views);
  ray_picture out = {reference_alloc(3 * pixels, sizeof(double)), reference_alloc(pixels, sizeof(double)),
                     reference_alloc(pixels, 1), reference_alloc(3 * pixels, sizeof(double))};
  const int lens = reference_has_lens(camera);
  for (int64_t k = 0; k < pixels; k++) {
    const double x = (double)(k % from->width) + 0.5, y = (double)(k / from->width) + 0.5;
    double *const ray = out.rays + 3 * k;
    out.transmittance[k] = 1;
    ray[0] = (x - camera->cx) / camera->fx, ray[1] = (y - camera->cy) / camera->fy, ray[2] = 1;
    if (lens && !reference_lens_ray(camera, x, y, ray)) {
      ray[0] = ray[1] = ray[2] = 0;
      out.stopped[k] = 1;
      out.transmittance[k] = 0;
    }
  }
  for (int p = 0; p < part_count; p++)
    views[p] = reference_view_of(&parts[p], camera, options), views[p].lens = reference_lens_of(camera);
  const int64_t drawn = reference_front_to_back(from, order);
  for (int64_t k = 0; k < drawn; k++) {
    const reference_splat *splat = &from->splats[order[k]];
    const int p = part_of(parts, order[k], &row);
    ray_splat ray;
    if (find_ray_splat(&parts[p], row, &views[p], camera, (double)options->low_pass, splat->least, splat, &ray))
      blend_splat(from, splat, &ray, camera, &out);
  }
  for (int64_t k = 0; k < pixels; k++) {
    double behind[3], margin = INFINITY;
    reference_behind(camera, options, k, behind, &margin);
    for (int c = 0; c < 3; c++)
      out.rgb[c * pixels + k] += out.transmittance[k] * behind[c];
  }
  free(order);
  free(views);
  free(out.transmittance);
  free(out.stopped);
  free(out.rays);
  return out.rgb;
}
