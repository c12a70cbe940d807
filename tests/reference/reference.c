/* SPDX-License-Identifier: Apache-2.0 */
/* Forward pass of the double-precision oracle; see reference.h for the definition. */
#include "reference/reference.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void *reference_alloc(int64_t count, size_t size) {
  void *memory = calloc(count > 0 ? (size_t)count : 1, size);
  if (!memory) {
    fprintf(stderr, "reference: out of memory\n");
    abort();
  }
  return memory;
}

/* ---- Parts ---- */

reference_part reference_part_create(int64_t count, int sh_degree) {
  reference_part part = {.count = count, .sh_degree = sh_degree};
  part.planes = reference_alloc(count * pags_plane_count(sh_degree), sizeof(double));
  part.world_from_model[0] = part.world_from_model[5] = part.world_from_model[10] = 1;
  return part;
}

reference_part reference_part_from(const pags_part *from) {
  const pags_gaussians *g = from->gaussians;
  reference_part part = reference_part_create(g->count, g->sh_degree);
  for (int plane = 0; plane < pags_plane_count(g->sh_degree); plane++) {
    for (int64_t i = 0; i < g->count; i++)
      part.planes[plane * g->count + i] = (double)g->data[plane * g->stride + i];
  }
  const int64_t values = 3 * pags_sh_coefficients(g->sh_degree) * g->count;
  part.sh = from->sh ? reference_alloc(values, sizeof(double)) : NULL;
  for (int64_t k = 0; part.sh && k < values; k++)
    part.sh[k] = (double)from->sh[k / g->count * g->stride + k % g->count];
  part.factor = from->opacity_factor ? reference_alloc(g->count, sizeof(double)) : NULL;
  for (int64_t i = 0; part.factor && i < g->count; i++)
    part.factor[i] = (double)from->opacity_factor[i];
  part.alpha_min = (double)g->alpha_min;
  part.id = from->id;
  part.first_id = from->first_id;
  memcpy(part.world_from_model, from->world_from_model, sizeof part.world_from_model);
  memcpy(part.velocity, from->velocity, sizeof part.velocity);
  return part;
}

void reference_part_destroy(reference_part *part) {
  free(part->planes);
  free(part->sh);
  free(part->factor);
  *part = (reference_part){0};
}

/* ---- Geometry ---- */

reference_view reference_view_of(const reference_part *part, const pags_camera *camera,
                                 const pags_frame_options *options) {
  const double *c = camera->world_from_camera, *m = part->world_from_model;
  reference_view view = {.widened = REFERENCE_WIDENED};
  double offset[3]; /* model origin - camera, world axes */
  for (int k = 0; k < 3; k++)
    offset[k] = m[4 * k + 3] - (c[4 * k + 3] - options->origin[k]);
  for (int row = 0; row < 3; row++) {
    view.translation[row] = view.position[row] = 0;
    /* A row of the pose's inverse: the cross product of two columns divided by the determinant. */
    double inverse[3], determinant = 0;
    for (int k = 0; k < 3; k++) {
      const int a = (k + 1) % 3, b = (k + 2) % 3, next = (row + 1) % 3, last = (row + 2) % 3;
      inverse[k] = m[4 * a + next] * m[4 * b + last] - m[4 * b + next] * m[4 * a + last];
      determinant += inverse[k] * m[4 * k + row];
    }
    for (int k = 0; k < 3; k++) {
      view.translation[row] += c[4 * k + row] * offset[k];
      view.position[row] -= inverse[k] / determinant * offset[k];
    }
    for (int column = 0; column < 3; column++) {
      view.rotation[3 * row + column] = 0;
      for (int k = 0; k < 3; k++)
        view.rotation[3 * row + column] += c[4 * k + row] * m[4 * k + column];
    }
  }
  return view;
}

static void rotation_of(const double q[4], double r[9]) {
  double w = q[0], x = q[1], y = q[2], z = q[3];
  double rotation[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  memcpy(r, rotation, sizeof rotation);
}

static void normalise_quaternion(const reference_part *part, int64_t i, reference_projection *p) {
  double square = 0;
  for (int k = 0; k < 4; k++) {
    p->unit_quaternion[k] = reference_value(part, PAGS_ROTATION + k, i);
    square += p->unit_quaternion[k] * p->unit_quaternion[k];
  }
  p->quaternion_length = sqrt(square);
  for (int k = 0; k < 4; k++) {
    if (p->quaternion_length == 0)
      p->unit_quaternion[k] = k == 0;
    else
      p->unit_quaternion[k] /= p->quaternion_length;
  }
}

/* x/z clamped to [-c/f - widened tan, (size - c)/f + widened tan]; side is -1, 0 or 1. */
static double clamp_slope(double slope, double size, double f, double c, double widened, int *side, double *margin) {
  double tangent = 0.5 * size / f;
  double lo = -c / f - widened * tangent, hi = (size - c) / f + widened * tangent;
  *margin = fmin(*margin, fmin(fabs(slope - lo), fabs(slope - hi)) / tangent);
  *side = slope < lo ? -1 : slope > hi ? 1 : 0;
  return slope < lo ? lo : slope > hi ? hi : slope;
}

/* 2x3 = 2x3 * 3x3 */
static void multiply_23(const double a[6], const double b[9], double out[6]) {
  for (int row = 0; row < 2; row++) {
    for (int column = 0; column < 3; column++) {
      out[3 * row + column] = a[3 * row] * b[column] + a[3 * row + 1] * b[3 + column] + a[3 * row + 2] * b[6 + column];
    }
  }
}

/* The projection through a lens, from sigmas and rotation on. */
static void project_through_lens(const reference_view *view, const pags_camera *camera, reference_projection *p,
                                 reference_splat *splat) {
  double point[3] = {splat->camera[0], splat->camera[1], splat->camera[2]}, to_camera[6], axes[9] = {0}, covariance[3];
  reference_lens_pixel(camera, point, splat->mean2d);
  for (int k = 0; k < 2 && view->lens.clamps; k++) {
    const double slope = point[k] / point[2], held = fmin(fmax(slope, view->lens.least[k]), view->lens.most[k]);
    splat->margin = fmin(splat->margin, fmin(fabs(slope - view->lens.least[k]), fabs(slope - view->lens.most[k])));
    splat->clamped_axis[k] = held < slope ? 1 : held > slope ? -1 : 0;
    point[k] = held * point[2];
  }
  reference_lens_jacobian(camera, point, p->jacobian);
  multiply_23(p->jacobian, view->rotation, to_camera);
  multiply_23(to_camera, p->rotation, p->factor);
  for (int k = 0; k < 6; k++)
    p->factor[k] *= p->sigma[k % 3];
  if (!view->sigma_points)
    return;
  for (int row = 0; row < 3; row++)
    for (int column = 0; column < 3; column++)
      for (int k = 0; k < 3; k++)
        axes[3 * row + column] += view->rotation[3 * row + k] * p->rotation[3 * k + column] * p->sigma[column];
  reference_lens_sigma_points(camera, splat->camera, axes, splat->mean2d, covariance);
  const double a = sqrt(covariance[0]), b = covariance[1] / a, c = sqrt(fmax(covariance[2] - b * b, 0));
  const double factor[6] = {a, 0, 0, b, c, 0};
  memcpy(p->factor, factor, sizeof factor);
}

reference_projection reference_project(const reference_part *part, int64_t i, const reference_view *view,
                                       const pags_camera *camera, reference_splat *splat) {
  reference_projection p;
  const double *xyz = splat->camera;
  splat->mean2d[0] = camera->fx * xyz[0] / xyz[2] + camera->cx;
  splat->mean2d[1] = camera->fy * xyz[1] / xyz[2] + camera->cy;

  normalise_quaternion(part, i, &p);
  rotation_of(p.unit_quaternion, p.rotation);
  for (int k = 0; k < 3; k++)
    p.sigma[k] = exp(reference_value(part, PAGS_SCALE + k, i));

  splat->margin = INFINITY;
  if (view->lens.is) {
    project_through_lens(view, camera, &p, splat);
    return p;
  }
  p.slope[0] = clamp_slope(xyz[0] / xyz[2], camera->width, camera->fx, camera->cx, view->widened,
                           &splat->clamped_axis[0], &splat->margin);
  p.slope[1] = clamp_slope(xyz[1] / xyz[2], camera->height, camera->fy, camera->cy, view->widened,
                           &splat->clamped_axis[1], &splat->margin);
  double jacobian[6] = {camera->fx / xyz[2],
                        0,
                        -camera->fx * p.slope[0] / xyz[2],
                        0,
                        camera->fy / xyz[2],
                        -camera->fy * p.slope[1] / xyz[2]};
  memcpy(p.jacobian, jacobian, sizeof jacobian);

  double to_camera[6];
  multiply_23(p.jacobian, view->rotation, to_camera);
  multiply_23(to_camera, p.rotation, p.factor);
  for (int k = 0; k < 6; k++)
    p.factor[k] *= p.sigma[k % 3];
  return p;
}

/* |row 0 x row 1|^2 is det(F F') without the cancellation of xx yy - xy^2. */
static double gram_determinant(const double f[6]) {
  double x = f[1] * f[5] - f[2] * f[4], y = f[2] * f[3] - f[0] * f[5], z = f[0] * f[4] - f[1] * f[3];
  return x * x + y * y + z * z;
}

/* Computes covariance, conic and compensation; returns 0 when the Gaussian has no area or isn't finite. */
static int find_covariance(const reference_projection *p, const pags_frame_options *options, reference_splat *splat) {
  const double *f = p->factor;
  double low_pass = (double)options->low_pass;
  double xx = f[0] * f[0] + f[1] * f[1] + f[2] * f[2];
  double xy = f[0] * f[3] + f[1] * f[4] + f[2] * f[5];
  double yy = f[3] * f[3] + f[4] * f[4] + f[5] * f[5];
  double before = gram_determinant(f);
  double after = before + low_pass * (xx + yy) + low_pass * low_pass;
  if (!(after > 0) || !isfinite(after))
    return 0;
  splat->cov[0] = xx + low_pass;
  splat->cov[1] = xy;
  splat->cov[2] = yy + low_pass;
  splat->conic[0] = splat->cov[2] / after;
  splat->conic[1] = -splat->cov[1] / after;
  splat->conic[2] = splat->cov[0] / after;
  splat->compensation = 1;
  if (options->antialiased) {
    double ratio = before / after;
    splat->floored = ratio <= REFERENCE_COMPENSATION_FLOOR;
    splat->compensation = sqrt(fmax(REFERENCE_COMPENSATION_FLOOR, ratio));
    splat->margin = fmin(splat->margin, fabs(ratio / REFERENCE_COMPENSATION_FLOOR - 1));
  }
  return 1;
}

/* ---- Colour ---- */

double reference_direction(const reference_part *part, int64_t i, const reference_view *view, double direction[3]) {
  double square = 0;
  for (int k = 0; k < 3; k++) {
    direction[k] = reference_value(part, PAGS_MEAN + k, i) - view->position[k];
    square += direction[k] * direction[k];
  }
  double distance = sqrt(square);
  for (int k = 0; k < 3; k++)
    direction[k] = distance > 0 ? direction[k] / distance : k == 2;
  return distance;
}

/* Real spherical harmonics as in the 3DGS code: constants sqrt((2l+1)(l-m)! / (4 pi (l+m)!)) with the Condon-Shortley
 * phase left in, m from -l to l. */
void reference_sh(const double d[3], double basis[16], double derivative[16][3]) {
  const double c0 = 0.28209479177387814, c1 = 0.4886025119029199;
  const double c2[3] = {1.0925484305920792, 0.31539156525252005, 0.5462742152960396};
  const double c3[4] = {0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154};
  const double c32 = 1.445305721320277;
  double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
  double value[16] = {
      c0,
      -c1 * y,
      c1 * z,
      -c1 * x,
      c2[0] * x * y,
      -c2[0] * y * z,
      c2[1] * (2 * zz - xx - yy),
      -c2[0] * x * z,
      c2[2] * (xx - yy),
      -c3[0] * y * (3 * xx - yy),
      c3[1] * x * y * z,
      -c3[2] * y * (4 * zz - xx - yy),
      c3[3] * z * (2 * zz - 3 * xx - 3 * yy),
      -c3[2] * x * (4 * zz - xx - yy),
      c32 * z * (xx - yy),
      -c3[0] * x * (xx - 3 * yy),
  };
  double slope[16][3] = {
      {0, 0, 0},
      {0, -c1, 0},
      {0, 0, c1},
      {-c1, 0, 0},
      {c2[0] * y, c2[0] * x, 0},
      {0, -c2[0] * z, -c2[0] * y},
      {-2 * c2[1] * x, -2 * c2[1] * y, 4 * c2[1] * z},
      {-c2[0] * z, 0, -c2[0] * x},
      {2 * c2[2] * x, -2 * c2[2] * y, 0},
      {-6 * c3[0] * x * y, -3 * c3[0] * (xx - yy), 0},
      {c3[1] * y * z, c3[1] * x * z, c3[1] * x * y},
      {2 * c3[2] * x * y, -c3[2] * (4 * zz - xx - 3 * yy), -8 * c3[2] * y * z},
      {-6 * c3[3] * x * z, -6 * c3[3] * y * z, c3[3] * (6 * zz - 3 * xx - 3 * yy)},
      {-c3[2] * (4 * zz - 3 * xx - yy), 2 * c3[2] * x * y, -8 * c3[2] * x * z},
      {2 * c32 * x * z, -2 * c32 * y * z, c32 * (xx - yy)},
      {-3 * c3[0] * (xx - yy), 6 * c3[0] * x * y, 0},
  };
  memcpy(basis, value, sizeof value);
  memcpy(derivative, slope, sizeof slope);
}

int reference_sh_degree(const reference_part *part, const pags_frame_options *options) {
  return part->sh_degree < options->sh_degree ? part->sh_degree : options->sh_degree;
}

static void find_colour(const reference_part *part, int64_t i, const reference_view *view,
                        const pags_frame_options *options, reference_splat *splat) {
  double direction[3], basis[16], derivative[16][3];
  reference_direction(part, i, view, direction);
  reference_sh(direction, basis, derivative);
  int coefficients = pags_sh_coefficients(reference_sh_degree(part, options));
  for (int channel = 0; channel < 3; channel++) {
    double sum = 0.5;
    for (int k = 0; k < coefficients; k++)
      sum += basis[k] * reference_value(part, PAGS_SH + 3 * k + channel, i);
    splat->clamped_colour[channel] = !(sum >= 0); /* also if the sum is NaN */
    splat->colour[channel] = splat->clamped_colour[channel] ? 0 : sum;
    splat->margin = fmin(splat->margin, fabs(sum));
  }
}

/* Returns whether the mean is outside of one of the planes. */
static bool clipped(const reference_splat *splat, const pags_camera *camera, const pags_frame_options *options) {
  const double *const m = camera->world_from_camera, *const s = splat->camera;
  bool out = false;
  for (int i = 0; i < options->clip_count; i++) {
    double sum = options->clips[i][3];
    for (int row = 0; row < 3; row++)
      sum +=
          options->clips[i][row] * (m[4 * row] * s[0] + m[4 * row + 1] * s[1] + m[4 * row + 2] * s[2] + m[4 * row + 3]);
    out = out || sum < 0;
  }
  return out;
}

static void find_camera(const reference_part *part, int64_t i, const reference_view *view, double camera[3]) {
  for (int row = 0; row < 3; row++) {
    camera[row] = view->translation[row];
    for (int k = 0; k < 3; k++)
      camera[row] += view->rotation[3 * row + k] * reference_value(part, PAGS_MEAN + k, i);
  }
}

/* The view `seconds` after the middle of the exposure. */
static reference_view view_at(const reference_part *part, const reference_view *middle, const pags_camera *camera,
                              const pags_frame_options *options, double seconds) {
  const reference_moment moment = reference_moment_at(part, camera, seconds);
  reference_view view = reference_view_of(&moment.part, &moment.camera, options);
  view.widened = middle->widened;
  view.lens = middle->lens;
  view.sigma_points = middle->sigma_points;
  return view;
}

static reference_splat find_splat(const reference_part *part, int64_t i, const reference_view *middle,
                                  const pags_camera *camera, const pags_frame_options *options, double least) {
  reference_splat splat = {.id = part->id ? part->id[i] : part->first_id + (int32_t)i};
  reference_line line = {.shear = {1, 0, 0, 1}, .margin = INFINITY};
  reference_view own = *middle, seen = *middle;
  find_camera(part, i, middle, splat.camera);
  if (clipped(&splat, camera, options))
    return splat;
  if (pags_camera_rolls(camera)) {
    line = reference_find_line(part, i, camera, options);
    own = view_at(part, middle, camera, options, line.seconds);
    seen = view_at(part, middle, camera, options, line.seen);
    splat.held = line.held;
    find_camera(part, i, &own, splat.camera);
  }
  const reference_view *const view = &own;
  const double *const at = splat.camera;
  splat.depth = view->lens.is ? sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]) : at[2];
  if (!(splat.depth > (double)options->near_plane))
    return splat;
  if (view->lens.is && !(acos(fmin(fmax(at[2] / splat.depth, -1), 1)) <= view->lens.farthest))
    return splat;
  reference_projection p = reference_project(part, i, view, camera, &splat);
  splat.margin = fmin(splat.margin, line.margin);
  for (int k = 0; k < 3; k++) {
    const double x = p.factor[k], y = p.factor[3 + k];
    p.factor[k] = line.shear[0] * x + line.shear[1] * y;
    p.factor[3 + k] = line.shear[2] * x + line.shear[3] * y;
  }
  if (!find_covariance(&p, options, &splat))
    return splat;
  splat.opacity = splat.compensation / (1 + exp(-reference_value(part, PAGS_OPACITY, i)));
  splat.opacity *= reference_factor(part, i);
  splat.least = least;
  splat.gain = 1;
  if (part->alpha_min > 0) {
    splat.least = fmax(part->alpha_min * splat.compensation, fmin(part->alpha_min, REFERENCE_ALPHA_MIN));
    splat.gain = 1 / (1 - part->alpha_min);
    splat.floor = splat.gain * splat.least;
  }
  if (!(splat.opacity > 0 && splat.opacity >= splat.least))
    return splat;
  find_colour(part, i, &seen, options, &splat);
  splat.drawn = 1;
  return splat;
}

/* ---- Blending ---- */

typedef struct pixel_state {
  double weight_sum, best_weight, last_depth;
  int stopped;
} pixel_state;

static void hash_in(uint64_t *hash, uint64_t value) {
  *hash = (*hash ^ value) * 0x100000001b3u; /* FNV-1a, word by word */
  *hash ^= *hash >> 29;
}

static void append(reference_picture *picture, int64_t *capacity, reference_contribution contribution) {
  if (picture->contribution_count == *capacity) {
    *capacity = *capacity ? 2 * *capacity : 4096;
    reference_contribution *grown = reference_alloc(*capacity, sizeof *grown);
    if (picture->contributions)
      memcpy(grown, picture->contributions, (size_t)picture->contribution_count * sizeof *grown);
    free(picture->contributions);
    picture->contributions = grown;
  }
  picture->contributions[picture->contribution_count++] = contribution;
}

static void keep_smaller(double *value, double candidate) {
  if (candidate < *value)
    *value = candidate;
}

static void blend(reference_picture *picture, int64_t *capacity, pixel_state *state, int32_t pixel, int64_t gaussian,
                  double shift) {
  const reference_splat *splat = &picture->splats[gaussian];
  double dx = pixel % picture->width + 0.5 - splat->mean2d[0] - shift;
  double dy = pixel / picture->width + 0.5 - splat->mean2d[1];
  double power = -0.5 * (splat->conic[0] * dx * dx + 2 * splat->conic[1] * dx * dy + splat->conic[2] * dy * dy);
  double falloff = exp(power), whole = splat->opacity * falloff, raw = splat->gain * whole - splat->floor;
  keep_smaller(&picture->margin[pixel], fabs(whole / splat->least - 1));
  if (whole < splat->least)
    return;
  double alpha = fmin(picture->limits.alpha_cap, raw);
  double before = picture->transmittance[pixel], after = before * (1 - alpha);
  keep_smaller(&picture->margin[pixel], fabs(after / picture->limits.stop - 1));
  keep_smaller(&picture->margin[pixel], fabs(raw / picture->limits.alpha_cap - 1));
  keep_smaller(&picture->margin[pixel], splat->margin);
  if (shift == 0)
    keep_smaller(&picture->depth_margin[pixel], (splat->depth - state->last_depth) / splat->depth);
  state->last_depth = splat->depth;
  if (after < picture->limits.stop) {
    state->stopped = 1;
    hash_in(&picture->decisions, (uint64_t)pixel * 2654435761u + 77);
    return;
  }
  double weight = alpha * before;
  int64_t pixels = (int64_t)picture->width * picture->height;
  for (int channel = 0; channel < 3; channel++)
    picture->rgb[channel * pixels + pixel] += weight * splat->colour[channel];
  picture->depth_sum[pixel] += weight * splat->depth;
  state->weight_sum += weight;
  if (weight > state->best_weight) {
    state->best_weight = weight;
    picture->id[pixel] = splat->id;
  }
  picture->transmittance[pixel] = after;
  append(picture, capacity, (reference_contribution){pixel, gaussian, falloff, raw, before});
  hash_in(&picture->decisions, (uint64_t)pixel << 32 ^ (uint64_t)gaussian << 1 ^ (raw > picture->limits.alpha_cap));
}

/* Blends a Gaussian into the pixels of its ellipse's box; outside of the box alpha is below the least alpha. One
 * more pixel on each side is visited, as it may lie close to the threshold. */
static void blend_box(reference_picture *picture, int64_t *capacity, pixel_state *states, int64_t gaussian) {
  const reference_splat *splat = &picture->splats[gaussian];
  double reach = fmax(0, 2 * log(splat->opacity / splat->least));
  double half_width = sqrt(reach * splat->cov[0]) + 1, half_height = sqrt(reach * splat->cov[2]) + 1;
  double x0 = fmax(0, floor(splat->mean2d[0] - half_width)), x1 = fmin(picture->width, splat->mean2d[0] + half_width);
  double y0 = fmax(0, floor(splat->mean2d[1] - half_height)),
         y1 = fmin(picture->height, splat->mean2d[1] + half_height);
  if (picture->turn > 0)
    x0 = 0, x1 = picture->width;
  for (int y = (int)fmin(y0, picture->height); y < y1; y++) {
    for (int x = (int)fmin(x0, picture->width); x < x1; x++) {
      int32_t pixel = (int32_t)(y * picture->width + x);
      if (!states[pixel].stopped)
        blend(picture, capacity, &states[pixel], pixel, gaussian, 0);
      /* The Gaussian is also drawn on the other side of the seam. */
      if (picture->turn > 0 && !states[pixel].stopped)
        blend(picture, capacity, &states[pixel], pixel, gaussian,
              splat->mean2d[0] > picture->middle ? -picture->turn : picture->turn);
    }
  }
  for (int k = 0; k < 3; k++)
    hash_in(&picture->decisions, (uint64_t)splat->clamped_colour[k] + 3);
  for (int k = 0; k < 2; k++)
    hash_in(&picture->decisions, (uint64_t)(splat->clamped_axis[k] + 7));
  hash_in(&picture->decisions, (uint64_t)splat->floored + 11);
}

typedef struct order_entry {
  double depth;
  int32_t id;
  int64_t gaussian;
} order_entry;

static int compare_order(const void *a, const void *b) {
  const order_entry *p = a, *q = b;
  if (p->depth != q->depth)
    return p->depth < q->depth ? -1 : 1;
  return (p->id > q->id) - (p->id < q->id);
}

int64_t reference_front_to_back(const reference_picture *picture, int64_t *gaussians) {
  order_entry *order = reference_alloc(picture->splat_count, sizeof *order);
  int64_t drawn = 0;
  for (int64_t i = 0; i < picture->splat_count; i++) {
    if (picture->splats[i].drawn)
      order[drawn++] = (order_entry){picture->splats[i].depth, picture->splats[i].id, i};
  }
  qsort(order, (size_t)drawn, sizeof *order, compare_order);
  for (int64_t k = 0; k < drawn; k++)
    gaussians[k] = order[k].gaussian;
  free(order);
  return drawn;
}

static void blend_all(reference_picture *picture) {
  int64_t *order = reference_alloc(picture->splat_count, sizeof *order);
  const int64_t drawn = reference_front_to_back(picture, order);

  int64_t pixels = (int64_t)picture->width * picture->height, capacity = 0;
  pixel_state *states = reference_alloc(pixels, sizeof *states);
  for (int64_t pixel = 0; pixel < pixels; pixel++)
    states[pixel].last_depth = -INFINITY;
  for (int64_t k = 0; k < drawn; k++)
    blend_box(picture, &capacity, states, order[k]);
  for (int64_t pixel = 0; pixel < pixels; pixel++)
    picture->depth[pixel] = states[pixel].weight_sum > 0 ? picture->depth_sum[pixel] / states[pixel].weight_sum : 0;
  free(states);
  free(order);
}

void reference_behind(const pags_camera *camera, const pags_frame_options *options, int64_t pixel, double rgb[3],
                      double *margin) {
  for (int channel = 0; channel < 3; channel++)
    rgb[channel] = (double)options->background[channel];
  if (!options->sky || options->sky->size == 0)
    return;
  const int x = (int)(pixel % camera->width), y = (int)(pixel / camera->width);
  pags_camera seen = *camera;
  if (pags_camera_rolls(camera)) {
    const reference_part none = {0};
    seen = reference_moment_at(&none, camera, pags_camera_read_at(camera, x + 0.5, y + 0.5)).camera;
  }
  const reference_sky_taps taps = reference_sky_look(options->sky, &seen, x, y);
  reference_sky_colour(options->sky, &taps, rgb);
  keep_smaller(margin, taps.margin);
}

reference_picture reference_render(const reference_part *parts, int part_count, const pags_camera *camera,
                                   const pags_frame_options *options) {
  return reference_render_within(REFERENCE_LIMITS, parts, part_count, camera, options);
}

reference_picture reference_render_within(reference_limits limits, const reference_part *parts, int part_count,
                                          const pags_camera *camera, const pags_frame_options *options) {
  int64_t pixels = (int64_t)camera->width * camera->height;
  reference_picture picture = {
      .width = camera->width, .height = camera->height, .limits = limits, .decisions = 0xcbf29ce484222325u};
  picture.rgb = reference_alloc(3 * pixels, sizeof(double));
  picture.transmittance = reference_alloc(pixels, sizeof(double));
  picture.depth_sum = reference_alloc(pixels, sizeof(double));
  picture.depth = reference_alloc(pixels, sizeof(double));
  picture.id = reference_alloc(pixels, sizeof(int32_t));
  picture.margin = reference_alloc(pixels, sizeof(double));
  picture.depth_margin = reference_alloc(pixels, sizeof(double));
  for (int64_t pixel = 0; pixel < pixels; pixel++) {
    picture.transmittance[pixel] = 1;
    picture.id[pixel] = -1;
    picture.margin[pixel] = picture.depth_margin[pixel] = INFINITY;
  }

  for (int p = 0; p < part_count; p++)
    picture.splat_count += parts[p].count;
  picture.splats = reference_alloc(picture.splat_count, sizeof *picture.splats);
  int64_t next = 0;
  const reference_lens lens = reference_lens_of(camera);
  picture.turn = lens.turn;
  picture.middle = camera->cx;
  for (int p = 0; p < part_count; p++) {
    reference_view view = reference_view_of(&parts[p], camera, options);
    view.widened = limits.widened;
    view.lens = lens;
    view.sigma_points = limits.sigma_points;
    for (int64_t i = 0; i < parts[p].count; i++)
      picture.splats[next++] = find_splat(&parts[p], i, &view, camera, options, limits.alpha_min);
  }

  blend_all(&picture);
  for (int64_t pixel = 0; pixel < pixels; pixel++) {
    double behind[3];
    reference_behind(camera, options, pixel, behind, &picture.margin[pixel]);
    for (int channel = 0; channel < 3; channel++)
      picture.rgb[channel * pixels + pixel] += picture.transmittance[pixel] * behind[channel];
    double ray[3];
    if (lens.is && !reference_lens_ray(camera, (double)(pixel % camera->width) + 0.5,
                                       (double)(pixel / camera->width) + 0.5, ray)) {
      for (int channel = 0; channel < 3; channel++)
        picture.rgb[channel * pixels + pixel] = 0;
      picture.transmittance[pixel] = 1;
      picture.depth_sum[pixel] = picture.depth[pixel] = 0;
      picture.id[pixel] = -1;
    }
  }
  return picture;
}

void reference_picture_destroy(reference_picture *picture) {
  free(picture->rgb);
  free(picture->transmittance);
  free(picture->depth_sum);
  free(picture->depth);
  free(picture->id);
  free(picture->margin);
  free(picture->depth_margin);
  free(picture->splats);
  free(picture->contributions);
  *picture = (reference_picture){0};
}
