/* SPDX-License-Identifier: Apache-2.0 */
/* Backward pass of the double-precision oracle: the chain rule through reference.c, from the last step to the first.
 *
 * Convention for symmetric 2x2 matrices (xx, xy, yy): the derivative by xy counts both off-diagonal entries. */
#include "reference/reference.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Derivatives of the loss by the values of a Gaussian that pixels use. */
typedef struct splat_gradient {
  double mean2d[2], conic[3], opacity, colour[3], depth;
} splat_gradient;

/* Pixels, back to front.
 *
 * rgb = sum_k w_k c_k + T background (or sky), w_k = alpha_k T_k, T_{k+1} = (1 - alpha_k) T_k. With the value of a
 * Gaussian at a pixel v_k = c_k . dL/drgb + z_k dL/ddepth_sum, and B_k what lies behind it, background included:
 *   dL/dalpha_k = T_k v_k - B_k / (1 - alpha_k). */
static void contribution_backward(const reference_contribution *c, const reference_splat *splat,
                                  const reference_picture *picture, const double rgb[3], double depth_sum,
                                  double *behind, splat_gradient *g) {
  double alpha = fmin(REFERENCE_ALPHA_CAP, c->alpha_raw), weight = alpha * c->transmittance;
  double value = depth_sum * splat->camera[2];
  for (int channel = 0; channel < 3; channel++) {
    value += rgb[channel] * splat->colour[channel];
    g->colour[channel] += weight * rgb[channel];
  }
  g->depth += weight * depth_sum;
  double by_alpha = c->transmittance * value - *behind / (1 - alpha);
  *behind += weight * value;
  if (c->alpha_raw > REFERENCE_ALPHA_CAP)
    return;

  double dx = c->pixel % picture->width + 0.5 - splat->mean2d[0];
  double dy = c->pixel / picture->width + 0.5 - splat->mean2d[1];
  double by_power = by_alpha * splat->gain * splat->opacity * c->falloff;
  double x = by_power * (splat->conic[0] * dx + splat->conic[1] * dy);
  double y = by_power * (splat->conic[1] * dx + splat->conic[2] * dy);
  g->opacity += by_alpha * splat->gain * c->falloff;
  g->mean2d[0] += x;
  g->mean2d[1] += y;
  g->conic[0] -= 0.5 * by_power * dx * dx;
  g->conic[1] -= by_power * dx * dy;
  g->conic[2] -= 0.5 * by_power * dy * dy;
}

static void pixels_backward(const reference_picture *picture, const pags_camera *camera,
                            const pags_frame_options *options, const reference_picture_gradient *gradient,
                            splat_gradient *out) {
  int64_t pixels = (int64_t)picture->width * picture->height;
  double *behind = reference_alloc(pixels, sizeof(double));
  for (int64_t pixel = 0; pixel < pixels; pixel++) {
    double by_transmittance = gradient->transmittance ? gradient->transmittance[pixel] : 0;
    double colour[3], margin = INFINITY;
    reference_behind(camera, options, pixel, colour, &margin);
    for (int channel = 0; gradient->rgb && channel < 3; channel++)
      by_transmittance += gradient->rgb[channel * pixels + pixel] * colour[channel];
    behind[pixel] = picture->transmittance[pixel] * by_transmittance;
  }
  for (int64_t k = picture->contribution_count - 1; k >= 0; k--) {
    const reference_contribution *c = &picture->contributions[k];
    double rgb[3] = {0, 0, 0};
    for (int channel = 0; gradient->rgb && channel < 3; channel++)
      rgb[channel] = gradient->rgb[channel * pixels + c->pixel];
    double depth_sum = gradient->depth_sum ? gradient->depth_sum[c->pixel] : 0;
    contribution_backward(c, &picture->splats[c->gaussian], picture, rgb, depth_sum, &behind[c->pixel],
                          &out[c->gaussian]);
  }
  free(behind);
}

static void sky_backward(const reference_picture *picture, const pags_camera *camera, const pags_sky *sky,
                         const reference_picture_gradient *gradient) {
  const int64_t pixels = (int64_t)picture->width * picture->height;
  for (int64_t pixel = 0; pixel < pixels; pixel++) {
    const reference_sky_taps taps =
        reference_sky_look(sky, camera, (int)(pixel % picture->width), (int)(pixel / picture->width));
    for (int channel = 0; channel < 3; channel++) {
      const double by_colour = picture->transmittance[pixel] * gradient->rgb[channel * pixels + pixel];
      for (int k = 0; k < 4; k++)
        gradient->sky[3 * taps.texel[k] + channel] += taps.weight[k] * by_colour;
    }
  }
}

/* d(A^-1) = -A^-1 dA A^-1, hence dL/dcov = -conic dL/dconic conic. */
static void conic_backward(const double conic[3], const double by_conic[3], double by_cov[3]) {
  double a = conic[0], b = conic[1], c = conic[2];
  double p = by_conic[0], q = 0.5 * by_conic[1], r = by_conic[2];
  double left[4] = {a * p + b * q, a * q + b * r, b * p + c * q, b * q + c * r};
  by_cov[0] -= left[0] * a + left[1] * b;
  by_cov[1] -= 2 * (left[0] * b + left[1] * c);
  by_cov[2] -= left[2] * b + left[3] * c;
}

/* compensation = sqrt(before / after), after = det cov, before = det(cov - low_pass I); constant at its floor. */
static void compensation_backward(const reference_splat *splat, double low_pass, double by_compensation,
                                  double by_cov[3]) {
  if (splat->floored)
    return;
  double xx = splat->cov[0], xy = splat->cov[1], yy = splat->cov[2];
  double after = xx * yy - xy * xy, ratio = splat->compensation * splat->compensation;
  double by_ratio = by_compensation * 0.5 / splat->compensation;
  by_cov[0] += by_ratio * ((yy - low_pass) - ratio * yy) / after;
  by_cov[1] += by_ratio * (-2 * xy + 2 * ratio * xy) / after;
  by_cov[2] += by_ratio * ((xx - low_pass) - ratio * xx) / after;
}

/* Derivative of the matrix R(q) of a unit quaternion, entry by entry. */
static void rotation_backward(const double q[4], const double g[9], double by_q[4]) {
  double w = q[0], x = q[1], y = q[2], z = q[3];
  by_q[0] = 2 * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]));
  by_q[1] = 2 * (y * (g[1] + g[3]) + z * (g[2] + g[6]) + w * (g[7] - g[5]) - 2 * x * (g[4] + g[8]));
  by_q[2] = 2 * (x * (g[1] + g[3]) + z * (g[5] + g[7]) + w * (g[2] - g[6]) - 2 * y * (g[0] + g[8]));
  by_q[3] = 2 * (x * (g[2] + g[6]) + y * (g[5] + g[7]) + w * (g[3] - g[1]) - 2 * z * (g[0] + g[4]));
}

/* From the 2x3 factor F = J W R diag(sigma) to scales, quaternion and Jacobian. by_factor = dL/dF. */
static void factor_backward(const reference_projection *p, const reference_view *view, const double by_factor[6],
                            double by_scale[3], double by_quaternion[4], double by_jacobian[6]) {
  double to_camera[6] = {0}, by_rotation[9] = {0}, shape[9]; /* to_camera = J W, shape = W R diag(sigma) */
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) {
      shape[3 * row + column] = 0;
      for (int k = 0; k < 3; k++)
        shape[3 * row + column] += view->rotation[3 * row + k] * p->rotation[3 * k + column] * p->sigma[column];
      for (int k = 0; k < 2; k++)
        to_camera[3 * k + column] += p->jacobian[3 * k + row] * view->rotation[3 * row + column];
    }
  }
  for (int k = 0; k < 3; k++)
    by_scale[k] = by_factor[k] * p->factor[k] + by_factor[3 + k] * p->factor[3 + k]; /* by ln sigma */
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) {
      by_rotation[3 * row + column] =
          (to_camera[row] * by_factor[column] + to_camera[3 + row] * by_factor[3 + column]) * p->sigma[column];
    }
  }
  for (int row = 0; row < 2; row++) {
    for (int column = 0; column < 3; column++) {
      by_jacobian[3 * row + column] = 0;
      for (int k = 0; k < 3; k++)
        by_jacobian[3 * row + column] += by_factor[3 * row + k] * shape[3 * column + k];
    }
  }

  double by_unit[4], along = 0;
  rotation_backward(p->unit_quaternion, by_rotation, by_unit);
  for (int k = 0; k < 4; k++)
    along += by_unit[k] * p->unit_quaternion[k];
  for (int k = 0; k < 4; k++) {
    by_quaternion[k] =
        p->quaternion_length > 0 ? (by_unit[k] - along * p->unit_quaternion[k]) / p->quaternion_length : 0;
  }
}

/* mean2d = f s + c with s = x/z; J = [f/z .. -f clamp(s)/z]. One axis; adds to dL/dx and dL/dz. */
static void axis_backward(double f, double x, double z, double clamped_slope, int clamped, double by_mean2d,
                          double by_diagonal, double by_last, double *by_x, double *by_z) {
  double by_slope = clamped ? 0 : -by_last * f / z;
  by_slope += by_mean2d * f;
  *by_x += by_slope / z;
  *by_z += -by_slope * x / (z * z) - by_diagonal * f / (z * z) + by_last * f * clamped_slope / (z * z);
}

static void colour_backward(const reference_part *part, int64_t i, const reference_view *view,
                            const pags_frame_options *options, const reference_splat *splat, const double by_colour[3],
                            double *planes, double by_mean[3]) {
  double direction[3], basis[16], derivative[16][3], by_direction[3] = {0, 0, 0};
  double distance = reference_direction(part, i, view, direction);
  reference_sh(direction, basis, derivative);
  int coefficients = pags_sh_coefficients(reference_sh_degree(part, options));
  for (int channel = 0; channel < 3; channel++) {
    if (splat->clamped_colour[channel])
      continue;
    for (int k = 0; k < coefficients; k++) {
      int plane = PAGS_SH + 3 * k + channel;
      planes[plane * part->count + i] += basis[k] * by_colour[channel];
      for (int axis = 0; axis < 3; axis++)
        by_direction[axis] += derivative[k][axis] * reference_value(part, plane, i) * by_colour[channel];
    }
  }
  if (distance == 0)
    return;
  double along = 0;
  for (int axis = 0; axis < 3; axis++)
    along += by_direction[axis] * direction[axis];
  for (int axis = 0; axis < 3; axis++)
    by_mean[axis] += (by_direction[axis] - along * direction[axis]) / distance;
}

static void splat_backward(const reference_part *part, int64_t i, const reference_view *view, const pags_camera *camera,
                           const pags_frame_options *options, const reference_splat *drawn, const splat_gradient *g,
                           double *planes) {
  reference_splat splat = *drawn;
  reference_projection p = reference_project(part, i, view, camera, &splat);
  double factor = reference_factor(part, i),
         logistic = drawn->opacity / (drawn->compensation * factor); /* sigmoid(logit) */
  double by_cov[3] = {0, 0, 0};
  conic_backward(drawn->conic, g->conic, by_cov);
  if (options->antialiased)
    compensation_backward(drawn, (double)options->low_pass, g->opacity * logistic * factor, by_cov);

  double by_factor[6], by_scale[3], by_quaternion[4], by_jacobian[6]; /* cov = F F': dL/dF = 2 dL/dcov F */
  for (int k = 0; k < 3; k++) {
    by_factor[k] = 2 * by_cov[0] * p.factor[k] + by_cov[1] * p.factor[3 + k];
    by_factor[3 + k] = by_cov[1] * p.factor[k] + 2 * by_cov[2] * p.factor[3 + k];
  }
  factor_backward(&p, view, by_factor, by_scale, by_quaternion, by_jacobian);

  const double *c = drawn->camera;
  double by_camera[3] = {0, 0, g->depth}, by_mean[3] = {0, 0, 0};
  axis_backward(camera->fx, c[0], c[2], p.slope[0], drawn->clamped_axis[0], g->mean2d[0], by_jacobian[0],
                by_jacobian[2], &by_camera[0], &by_camera[2]);
  axis_backward(camera->fy, c[1], c[2], p.slope[1], drawn->clamped_axis[1], g->mean2d[1], by_jacobian[4],
                by_jacobian[5], &by_camera[1], &by_camera[2]);
  colour_backward(part, i, view, options, drawn, g->colour, planes, by_mean);

  int64_t n = part->count;
  for (int k = 0; k < 3; k++) {
    for (int row = 0; row < 3; row++)
      by_mean[k] += view->rotation[3 * row + k] * by_camera[row];
    planes[(PAGS_MEAN + k) * n + i] += by_mean[k];
    planes[(PAGS_SCALE + k) * n + i] += by_scale[k];
  }
  for (int k = 0; k < 4; k++)
    planes[(PAGS_ROTATION + k) * n + i] += by_quaternion[k];
  planes[PAGS_OPACITY * n + i] += g->opacity * drawn->compensation * factor * logistic * (1 - logistic);
}

void reference_backward(const reference_part *parts, int part_count, const pags_camera *camera,
                        const pags_frame_options *options, const reference_picture *picture,
                        const reference_picture_gradient *gradient, reference_part_gradient *out) {
  splat_gradient *splats = reference_alloc(picture->splat_count, sizeof *splats);
  assert(!pags_camera_rolls(camera));
  pixels_backward(picture, camera, options, gradient, splats);
  if (gradient->sky && gradient->rgb && options->sky)
    sky_backward(picture, camera, options->sky, gradient);
  int64_t next = 0;
  for (int p = 0; p < part_count; p++) {
    const reference_part *part = &parts[p];
    out[p].count = part->count;
    out[p].planes = reference_alloc(part->count * pags_plane_count(part->sh_degree), sizeof(double));
    out[p].mean2d = reference_alloc(2 * part->count, sizeof(double));
    reference_view view = reference_view_of(part, camera, options);
    for (int64_t i = 0; i < part->count; i++, next++) {
      if (!picture->splats[next].drawn)
        continue;
      splat_backward(part, i, &view, camera, options, &picture->splats[next], &splats[next], out[p].planes);
      memcpy(&out[p].mean2d[2 * i], splats[next].mean2d, sizeof splats[next].mean2d);
    }
  }
  free(splats);
}

void reference_gradient_destroy(reference_part_gradient *gradients, int part_count) {
  for (int p = 0; p < part_count; p++) {
    free(gradients[p].planes);
    free(gradients[p].mean2d);
    gradients[p] = (reference_part_gradient){0};
  }
}
