/* SPDX-License-Identifier: Apache-2.0 */
/* Projection of Gaussians through a lens, and its backward pass, in double precision, one Gaussian at a time.
 *
 * The covariance is projected by the Jacobian J of the lens at the mean (EWA: Zwicker et al. 2001), as in
 * simd/projection.h with its notation, where J is a pinhole's:
 *   M = J W R S,  [A B; B C] = M M' + low_pass I,  D0 = the sum of the squared 2x2 minors of M
 * Sigma points (Julier and Uhlmann 1997; Wu et al. 2024) were measured for comparison (docs/lab/lenses.md).
 *
 * Backward, L depends on the mean p by m(p), by the distance and by J. With G = dL/dJ, row g_i for row J_i,
 *   dL/dp_k = sum_ij G_ij dJ_ij/dp_k = sum_i (derivative of J_ik along g_i),
 * since the second derivatives of m_i are symmetric: two directional derivatives, taken as central differences of J,
 * whose error in double is below the rounding of the floats that are stored. */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/vec3.h"
#include "frame/lens_view.h"
#include "maths/maths.h"

static const double half_log2e = 0.72134752044448170;

/* The projection of a Gaussian, with the terms that the backward pass uses. */
typedef struct lens_projection {
  double p[3], distance, at[2]; /* mean in camera space, px */
  double q[3];                  /* where J is taken: p, or the nearest direction of a lens that clamps */
  bool clamped[2];
  double here[6], j[6]; /* derivatives at p and at q */
  double sigma[3], quaternion[4], inverse_norm, rotation[9], t[6], m[6], minor[3];
  double a, b, c, d0, d, compensation, opacity, rest;
} lens_projection;

typedef enum cull_result { CULLED_NEAR, CULLED_BEYOND, NOT_CULLED } cull_result;

/* ---- Forward ---- */

/* Computes the mean in camera space and in pixels, and J. */
static cull_result find_mean(const struct frame_lens *l, const pags_projection *v, const float *data, int64_t stride,
                             lens_projection *s) {
  for (int i = 0; i < 3; i++) {
    s->p[i] = (double)v->t[i];
    for (int k = 0; k < 3; k++)
      s->p[i] += (double)v->r[3 * i + k] * (double)data[(PAGS_MEAN + k) * stride];
  }
  s->distance = pags_length3(s->p);
  if (!(s->distance > (double)v->near_plane && s->distance < 1e18)) /* false for NaN */
    return CULLED_NEAR;
  if (!l->sphere && !(pags_lens_angle(s->p) <= l->farthest))
    return CULLED_BEYOND;
  pags_frame_lens_see(l, s->p, s->at, s->here);
  memcpy(s->q, s->p, sizeof s->q);
  for (int i = 0; i < 2; i++) {
    const double slope = l->clamps ? s->p[i] / s->p[2] : 0, clamped = fmin(fmax(slope, l->least[i]), l->most[i]);
    s->clamped[i] = l->clamps && clamped != slope;
    if (s->clamped[i])
      s->q[i] = clamped * s->p[2];
  }
  memcpy(s->j, s->here, sizeof s->j);
  if (s->clamped[0] || s->clamped[1]) {
    double unused[2];
    pags_frame_lens_see(l, s->q, unused, s->j);
  }
  return NOT_CULLED;
}

static cull_result project_row(const struct frame_lens *l, const pags_projection *v, const float *data, int64_t stride,
                               lens_projection *s) {
  const cull_result culled = find_mean(l, v, data, stride, s);
  if (culled != NOT_CULLED)
    return culled;
  double norm2 = 0;
  for (int k = 0; k < 4; k++) {
    s->quaternion[k] = (double)data[(PAGS_ROTATION + k) * stride];
    norm2 += s->quaternion[k] * s->quaternion[k];
  }
  const bool none = norm2 <= 0;
  const double inverse = none ? 0 : 1 / sqrt(norm2);
  s->inverse_norm = fmin(inverse, 1e15); /* as in simd/projection.h */
  for (int k = 0; k < 4; k++)
    s->quaternion[k] = none ? (k == 0 ? 1 : 0) : s->quaternion[k] * inverse;
  pags_rotation_from_quaternion(s->quaternion, s->rotation);
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      s->t[3 * i + k] =
          s->j[3 * i] * (double)v->r[k] + s->j[3 * i + 1] * (double)v->r[3 + k] + s->j[3 * i + 2] * (double)v->r[6 + k];
  for (int k = 0; k < 3; k++) {
    s->sigma[k] = pags_exp((double)data[(PAGS_SCALE + k) * stride]);
    for (int i = 0; i < 2; i++)
      s->m[3 * i + k] =
          (s->t[3 * i] * s->rotation[k] + s->t[3 * i + 1] * s->rotation[3 + k] + s->t[3 * i + 2] * s->rotation[6 + k]) *
          s->sigma[k];
  }
  const double *const m = s->m, low = (double)v->low_pass;
  s->minor[0] = m[0] * m[4] - m[1] * m[3];
  s->minor[1] = m[0] * m[5] - m[2] * m[3];
  s->minor[2] = m[1] * m[5] - m[2] * m[4];
  const double a0 = pags_dot3(m, m), c0 = pags_dot3(m + 3, m + 3);
  s->a = a0 + low;
  s->b = pags_dot3(m, m + 3);
  s->c = c0 + low;
  s->d0 = pags_dot3(s->minor, s->minor);
  s->d = s->d0 + low * (a0 + c0) + low * low;

  const double fade = pags_exp(-(double)data[PAGS_OPACITY * stride]), raw = 1 / (1 + fade);
  s->rest = fade < 1e300 ? fade * raw : 1;
  s->compensation = v->antialiased ? sqrt(fmax(2.5e-5, s->d0 / s->d)) : 1;
  s->opacity = raw * s->compensation;
  return NOT_CULLED;
}

/* Writes the splat, the box's extent and *reach of a Gaussian; returns its key, UINT32_MAX if it isn't drawn.
 * `across`: px by which it is moved, for its second place over the seam. */
static uint32_t write_splat(const pags_projection *v, const lens_projection *s, double factor, bool factored,
                            double across, pags_splat *out, pags_tile_box *box, pags_reach *reach) {
  pags_alpha_cut cut = v->alpha;
  if (v->antialiased && cut.floor != 0.0f) { /* as project_cuts of simd/project.c */
    const double scale = fmax(s->compensation, (double)(PAGS_ALPHA_MIN / cut.least));
    cut.least = (float)((double)cut.least * scale);
    cut.cut = (float)((double)cut.cut + pags_log2(scale));
    cut.floor = (float)((double)cut.floor * scale);
  }
  const double opacity = s->opacity * factor, x = s->at[0] + across, y = s->at[1];
  const double raw = pags_log2(fmax(opacity, 1e-30)), l = (factored ? raw : fmin(raw, 0)) + (double)v->alpha.lift;
  const double square = (l - (double)cut.cut) / half_log2e;
  const double half[2] = {sqrt(fmax(square * s->a, 0)), sqrt(fmax(square * s->c, 0))};
  for (int k = 0; k < v->clip_count; k++) {
    const float *const p = v->clips[k];
    if (!((double)p[0] * s->p[0] + (double)p[1] * s->p[1] + (double)p[2] * s->p[2] + (double)p[3] >= 0))
      return UINT32_MAX;
  }
  /* Comparisons are false for NaN. */
  const bool drawn = (float)opacity >= cut.least && s->a < 1e18 && s->c < 1e18 && s->d > 0 && s->d < 1e36 &&
                     x + half[0] > 0 && x - half[0] < (double)v->width && y + half[1] > 0 &&
                     y - half[1] < (double)v->height && fabs(x) < 1e18 && fabs(y) < 1e18;
  if (!drawn)
    return UINT32_MAX;
  *out = (pags_splat){.x = (float)x,
                      .y = (float)y,
                      .p = (float)sqrt(half_log2e * s->c / s->d),
                      .h = (float)(s->b / s->c),
                      .w = (float)sqrt(half_log2e / s->c),
                      .log2_opacity = (float)l,
                      .z = (float)s->distance,
                      .slope = (float)(s->b / s->a),
                      .cut = cut.cut,
                      .floor = cut.floor};
  box->extent[0] = (float)half[0], box->extent[1] = (float)half[1];
  if (reach) { /* a little larger than the splat's box, for the rounding of floats */
    const double wide = (l + (double)PAGS_CUT_SLACK - (double)cut.cut) / half_log2e;
    const double wide_x = sqrt(fmax(wide * s->a, 0)), wide_y = sqrt(fmax(wide * s->c, 0));
    lens_blocks(x, wide_x * 1.00001 + fabs(x) * 1e-6 + 1e-3, (double)v->width, &reach->x0, &reach->x1);
    lens_blocks(y, wide_y * 1.00001 + fabs(y) * 1e-6 + 1e-3, (double)v->height, &reach->y0, &reach->y1);
  }
  uint32_t key;
  memcpy(&key, &out->z, sizeof key);
  return key;
}

int pags_frame_project_lens(const pags_frame *f, const view_cluster *c, const float *rows, int64_t stride,
                            pags_reach *reaches) {
  const struct frame_lens *const lens = f->lens;
  const pags_projection *const v = f->projections + c->part;
  const float *const factors = f->parts[c->part].opacity_factor;
  int beyond = 0;
  for (int k = 0; k < c->count; k++) {
    lens_projection s;
    const cull_result culled = project_row(lens, v, rows + k, stride, &s);
    f->keys[c->base + k] = UINT32_MAX;
    beyond += culled == CULLED_BEYOND;
    if (culled != NOT_CULLED)
      continue;
    const double across = !c->turned ? 0 : s.at[0] > lens->camera.cx ? -lens->turn : lens->turn;
    f->keys[c->base + k] = write_splat(v, &s, factors ? (double)factors[c->first + k] : 1, factors, across,
                                       f->splats + c->base + k, f->boxes + c->base + k, reaches ? reaches + k : NULL);
  }
  return beyond;
}

/* ---- Backward ---- */

/* Adds up the row's slots, in single precision as gather_slots of simd/project_backward.c and add_slots of
 * shared_splats.c do, so that sums that another frame has taken have the same bits; the splat is drawn. */
static void add_slots(const pags_splat *splat, const float *slots, double sums[PAGS_SLOT_FLOATS]) {
  const double ln2 = 0.69314718055994531;
  for (int f = 0; f < PAGS_SLOT_FLOATS; f++) {
    float sum = slots[f];
    for (uint32_t i = 1; i < splat->tiles; i++)
      sum += slots[i * PAGS_SLOT_FLOATS + (uint32_t)f];
    sums[f] = (f >= PAGS_SLOT_R && f <= PAGS_SLOT_Z ? 1 : ln2) * (double)sum;
  }
}

/* dL/dM from dL/d(A0, B, C0, D0). */
static void covariance_backward(const lens_projection *s, double ga, double gb, double gc, double gd0, double gm[6]) {
  const double *const m = s->m;
  double e[3];
  for (int k = 0; k < 3; k++) {
    e[k] = 2 * gd0 * s->minor[k];
    gm[k] = 2 * ga * m[k] + gb * m[3 + k];
    gm[3 + k] = 2 * gc * m[3 + k] + gb * m[k];
  }
  gm[0] += e[0] * m[4] + e[1] * m[5];
  gm[1] += e[2] * m[5] - e[0] * m[3];
  gm[2] -= e[1] * m[3] + e[2] * m[4];
  gm[3] -= e[0] * m[1] + e[1] * m[2];
  gm[4] += e[0] * m[0] - e[2] * m[2];
  gm[5] += e[1] * m[0] + e[2] * m[1];
}

/* dL/dq of the quaternion as stored from dL/dR. */
static void quaternion_backward(const lens_projection *s, const double gr[9], double gq[4]) {
  const double w = s->quaternion[0], x = s->quaternion[1], y = s->quaternion[2], z = s->quaternion[3];
  const double g[4] = {2 * (x * (gr[7] - gr[5]) + y * (gr[2] - gr[6]) + z * (gr[3] - gr[1])),
                       2 * (y * (gr[1] + gr[3]) + z * (gr[2] + gr[6]) + w * (gr[7] - gr[5])) - 4 * x * (gr[4] + gr[8]),
                       2 * (x * (gr[1] + gr[3]) + z * (gr[5] + gr[7]) + w * (gr[2] - gr[6])) - 4 * y * (gr[0] + gr[8]),
                       2 * (x * (gr[2] + gr[6]) + y * (gr[5] + gr[7]) + w * (gr[3] - gr[1])) - 4 * z * (gr[0] + gr[4])};
  /* The derivative of the normalisation is (I - q q') / |q|. */
  const double along = w * g[0] + x * g[1] + y * g[2] + z * g[3];
  for (int k = 0; k < 4; k++)
    gq[k] = (g[k] - along * s->quaternion[k]) * s->inverse_norm;
}

/* Adds to gp what dL/dJ = g gives: the derivative of each row of J along its row of g. */
static void jacobian_backward(const struct frame_lens *l, const lens_projection *s, const double g[6], double gp[3]) {
  double by_q[3] = {0, 0, 0}, unused[2];
  const double length = pags_length3(s->q);
  for (int i = 0; i < 2; i++) {
    const double *const along = g + 3 * i;
    const double size = pags_length3(along);
    if (!(size > 0))
      continue;
    const double step = 1e-4 * length / size;
    double before[3], after[3], low[6], high[6];
    pags_along3(s->q, -step, along, before);
    pags_along3(s->q, step, along, after);
    pags_frame_lens_see(l, before, unused, low);
    pags_frame_lens_see(l, after, unused, high);
    for (int k = 0; k < 3; k++)
      by_q[k] += (high[3 * i + k] - low[3 * i + k]) / (2 * step);
  }
  for (int i = 0; i < 2; i++)
    if (s->clamped[i]) { /* q_i = clamped * p_z */
      by_q[2] += by_q[i] * s->q[i] / s->q[2];
      by_q[i] = 0;
    }
  pags_add3(gp, by_q, gp);
}

/* Adds the gradients of row k by its place and shape; the planes hold those by its colour. */
static void shape_backward(const struct frame_lens *l, const pags_projection *v, const lens_projection *s,
                           const double f[PAGS_SLOT_FLOATS], int k, const pags_row_gradient *out) {
  const double p = sqrt(half_log2e * s->c / s->d), h = s->b / s->c, w = sqrt(half_log2e / s->c);
  const double low = (double)v->low_pass;
  const double by_pixel[2] = {2 * p * f[PAGS_SLOT_SU], 2 * (w * f[PAGS_SLOT_SV] - p * h * f[PAGS_SLOT_SU])};
  const double gb = 2 * f[PAGS_SLOT_SUV] / sqrt(s->d), glog = f[PAGS_SLOT_S] * 1.44269504088896340;
  double gc = (f[PAGS_SLOT_SVV] - f[PAGS_SLOT_SUU]) / s->c - h * gb, gd = f[PAGS_SLOT_SUU] / s->d, gd0 = 0;
  if (v->antialiased && s->d0 / s->d > 2.5e-5) { /* d ln compensation = (dD0/D0 - dD/D) / 2 above its floor */
    gd0 = 0.5 * glog / s->d0;
    gd -= 0.5 * glog / s->d;
  }
  gd0 += gd;
  gc += low * gd;

  double gm[6], gt[6], gr[9], gq[4], gj[6], gp[3];
  covariance_backward(s, low * gd, gb, gc, gd0, gm);
  for (int i = 0; i < 3; i++)
    out->data[(PAGS_SCALE + i) * out->stride + k] = (float)(gm[i] * s->m[i] + gm[3 + i] * s->m[3 + i]);
  for (int i = 0; i < 6; i++)
    gm[i] *= s->sigma[i % 3];
  for (int i = 0; i < 3; i++) {
    const double *const r = s->rotation + 3 * i;
    gt[i] = pags_dot3(gm, r);
    gt[3 + i] = pags_dot3(gm + 3, r);
    for (int n = 0; n < 3; n++)
      gr[3 * i + n] = s->t[i] * gm[n] + s->t[3 + i] * gm[3 + n];
  }
  quaternion_backward(s, gr, gq);
  for (int i = 0; i < 4; i++)
    out->data[(PAGS_ROTATION + i) * out->stride + k] = (float)gq[i];
  out->data[PAGS_OPACITY * out->stride + k] = (float)(glog * s->rest);
  for (int i = 0; i < 3; i++) {
    const float *const r = v->r + 3 * i;
    gj[i] = gt[0] * (double)r[0] + gt[1] * (double)r[1] + gt[2] * (double)r[2];
    gj[3 + i] = gt[3] * (double)r[0] + gt[4] * (double)r[1] + gt[5] * (double)r[2];
    gp[i] = by_pixel[0] * s->here[i] + by_pixel[1] * s->here[3 + i] + f[PAGS_SLOT_Z] * s->p[i] / s->distance;
  }
  jacobian_backward(l, s, gj, gp);
  for (int i = 0; i < 3; i++)
    out->data[(PAGS_MEAN + i) * out->stride + k] +=
        (float)(gp[0] * (double)v->r[i] + gp[1] * (double)v->r[3 + i] + gp[2] * (double)v->r[6 + i]);

  const double half_w = 0.5 * (double)v->width, half_h = 0.5 * (double)v->height, middle = 0.5 * (s->a + s->c);
  out->mean2d[k] = (float)pags_hypot(by_pixel[0] * half_w, by_pixel[1] * half_h);
  out->radius[k] = (float)(3 * sqrt(middle + sqrt(fmax(0.1, middle * middle - s->d))));
}

int pags_frame_lens_backward(const pags_frame *frame, const view_cluster *c, const frame_members *members,
                             const float *slots, const pags_row_gradient *out) {
  const pags_projection *const v = frame->projections + c->part;
  const pags_part *const part = frame->parts + c->part;
  const pags_gaussians *const g = part->gaussians;
  const uint32_t *const keys = members->keys;
  const int planes = pags_plane_count(v->sh_degree);
  double sums[MOST_MEMBERS][PAGS_SLOT_FLOATS];
  float colours[MOST_MEMBERS * PAGS_SLOT_FLOATS] = {0.0f};
  pags_splat splats[MOST_MEMBERS];
  int64_t places[MOST_MEMBERS];
  assert(c->count <= MOST_MEMBERS && out->bad);
  for (int k = 0; k < c->count; k++) {
    splats[k] = members->splats[k];
    places[k] = k;
    if (keys[k] == UINT32_MAX || splats[k].tiles == 0)
      continue;
    add_slots(splats + k, slots + members->slot_start[k] * PAGS_SLOT_FLOATS, sums[k]);
    for (int f = PAGS_SLOT_R; f <= PAGS_SLOT_B; f++)
      colours[k * PAGS_SLOT_FLOATS + f] = (float)sums[k][f];
    splats[k].tiles = 1;
  }
  /* The gradients by the colours, and through the direction by the mean, are a pinhole's. Its kernel takes them along
   * with the shape of a camera in which all else is constant. */
  pags_projection alone = *v;
  memset(alone.r, 0, sizeof alone.r);
  alone.t[0] = alone.t[1] = alone.cx = alone.cy = alone.near_plane = 0.0f;
  alone.t[2] = alone.fx = alone.fy = alone.low_pass = alone.lim_x1 = alone.lim_y1 = 1.0f;
  alone.lim_x0 = alone.lim_y0 = -1.0f;
  alone.antialiased = 0;
  int bad =
      frame->kernels->project_backward(&alone, g->data + c->first, g->stride, part->sh ? part->sh + c->first : NULL,
                                       c->count, keys, splats, places, colours, out);
  for (int k = 0; k < c->count; k++) {
    lens_projection s;
    if (keys[k] == UINT32_MAX || splats[k].tiles == 0 || out->bad[k])
      continue;
    if (project_row(frame->lens, v, g->data + c->first + k, g->stride, &s) != NOT_CULLED)
      continue;
    shape_backward(frame->lens, v, &s, sums[k], k, out);

    /* A row with a value that isn't finite is set to zero. */
    int p = 0;
    while (p < planes && fabsf(out->data[p * out->stride + k]) < 3e38f)
      p++;
    if (p == planes)
      continue;
    out->bad[k] = (uint8_t)(p + 1);
    for (p = 0; p < planes; p++)
      out->data[p * out->stride + k] = 0.0f;
    out->mean2d[k] = 0.0f;
    bad++;
  }
  return bad;
}
