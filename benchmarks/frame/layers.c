/* SPDX-License-Identifier: Apache-2.0 */
/* Depth complexity of a picture from the areas of the projected Gaussians.
 *
 * alpha = o exp(-q/2) >= 1/255 holds in the ellipse q <= 2 ln(255 o), whose area is pi 2 ln(255 o) sqrt(det S), S
 * being the covariance on the picture plane. The areas are summed over the Gaussians whose mean lies in the picture
 * and divided by its number of pixels. An area counts as at most the picture's, but is not clipped at its edges: the
 * parts beyond an edge make up for Gaussians with their mean outside that reach into the picture. */
#include "benchmarks/frame/modes.h"

#include <math.h>
#include <string.h>
#include "maths/maths.h"
#include "scene/packed_rows.h"

/* Parameter planes of some Gaussians, of a model or of one unpacked cluster. */
typedef struct rows {
  const float *data;
  int64_t stride, count;
} rows;

static float value(const rows *g, int plane, int64_t i) {
  return g->data[plane * g->stride + i];
}

static void camera_from_part(const pags_part *part, const pags_camera *camera, const double origin[3], double out[12]) {
  double local[12], inverse[12];
  memcpy(local, camera->world_from_camera, sizeof local);
  for (int k = 0; k < 3; k++)
    local[4 * k + 3] -= origin[k];
  pags_rigid_inverse(local, inverse);
  pags_rigid_multiply(inverse, part->world_from_model, out);
}

/* Returns the area in px^2 where the Gaussian's alpha is at least 1/255. Covariance: S = J W R diag(sigma^2) R' W' J'
 * + low_pass. */
static double ellipse_area(const rows *g, int64_t i, const double m[12], const pags_camera *camera, const double p[3],
                           double low_pass) {
  const double logit = (double)value(g, PAGS_OPACITY, i), reach = 2 * (pags_log(255.0) - pags_log1p(pags_exp(-logit)));
  const double jx[3] = {camera->fx / p[2], 0, -camera->fx * p[0] / (p[2] * p[2])};
  const double jy[3] = {0, camera->fy / p[2], -camera->fy * p[1] / (p[2] * p[2])};
  double q[4], r[9], a = low_pass, b = 0, c = low_pass;
  if (reach <= 0)
    return 0;
  for (int k = 0; k < 4; k++)
    q[k] = (double)value(g, PAGS_ROTATION + k, i);
  pags_rotation_from_quaternion(q, r);
  for (int axis = 0; axis < 3; axis++) {
    const double sigma = pags_exp((double)value(g, PAGS_SCALE + axis, i));
    double u = 0, v = 0;
    for (int row = 0; row < 3; row++) {
      const double w = m[4 * row] * r[axis] + m[4 * row + 1] * r[3 + axis] + m[4 * row + 2] * r[6 + axis];
      u += jx[row] * w * sigma;
      v += jy[row] * w * sigma;
    }
    a += u * u;
    b += u * v;
    c += v * v;
  }
  return 3.14159265358979323846 * reach * sqrt(fmax(a * c - b * b, 0));
}

static double area_of_rows(const rows *g, const double m[12], const pags_camera *camera,
                           const pags_frame_options *options) {
  const double pixels = (double)camera->width * camera->height;
  double area = 0;
  for (int64_t i = 0; i < g->count; i++) {
    double p[3];
    for (int row = 0; row < 3; row++) {
      p[row] = m[4 * row + 3];
      for (int c = 0; c < 3; c++)
        p[row] += m[4 * row + c] * (double)value(g, PAGS_MEAN + c, i);
    }
    if (p[2] <= (double)options->near_plane)
      continue;
    const double x = camera->fx * p[0] / p[2] + camera->cx, y = camera->fy * p[1] / p[2] + camera->cy;
    if (x >= 0 && x < camera->width && y >= 0 && y < camera->height)
      area += fmin(ellipse_area(g, i, m, camera, p, (double)options->low_pass), pixels);
  }
  return area;
}

double pags_bench_layers(const pags_part *parts, int part_count, const pags_camera *camera,
                         const pags_frame_options *options) {
  double area = 0;
  for (int k = 0; k < part_count; k++) {
    const pags_gaussians *g = parts[k].gaussians;
    const rows planes = {g->data, g->stride, g->count};
    double m[12];
    camera_from_part(parts + k, camera, options->origin, m);
    if (!parts[k].packed)
      area += area_of_rows(&planes, m, camera, options);
    for (int64_t c = 0; parts[k].packed && c < parts[k].clusters->count; c++) {
      float unpacked[PAGS_PACKED_GEOMETRY_PLANES * PAGS_PACKED_ROWS];
      const int64_t left = g->count - c * PAGS_PACKED_ROWS;
      const rows cluster = {unpacked, PAGS_PACKED_ROWS, left < PAGS_PACKED_ROWS ? left : PAGS_PACKED_ROWS};
      pags_packed_geometry(parts[k].packed, c, unpacked);
      area += area_of_rows(&cluster, m, camera, options);
    }
  }
  return area / ((double)camera->width * camera->height);
}
